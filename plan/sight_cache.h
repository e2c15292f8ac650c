#pragma once
// Remembers which pieces of a scene's surface its sampling points see, for all who plan views of the scene. Views that
// are near each other, and many viewers of one scene, ask for nearly the same lines of sight, which cost a third of a
// microsecond each, and half of all that a plan does.
//
// A line is remembered by its point and the cell of the proxy's surface that it ends in
// (lod::patch::ProxySight::cellCount()), and it is computed for a fixed place in that cell. So an answer depends on the
// question alone, and never on who asked before or on the order of threads.
#include <atomic>
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <mutex>
#include <vector>

#include "lod/patch/proxy_sight.h"
#include "repository/cache.h"

namespace plan {

/// Safe from any thread.
class SightCache {
 public:
  /// Takes a few hundred points with the usual proxy.
  static constexpr std::uint64_t kUsualBytes = 4 << 20;

  /// `sight` must live as long. `clearance`: as ProxySight::isBlocked takes it. `budget`: bytes; what was used least
  /// recently is forgotten beyond it.
  SightCache(const lod::patch::ProxySight& sight, float clearance, std::uint64_t budget = kUsualBytes)
      : sight_(sight), clearance_(clearance), rows_(budget) {}

  /// The cells that one point sees, as far as somebody asked. Whoever holds a row may use it, forgotten or not.
  class Row {
   public:
    explicit Row(std::size_t cells) : verdicts_((cells + kPerWord - 1) / kPerWord) {}
    std::uint64_t bytes() const { return sizeof(Row) + verdicts_.size() * sizeof(verdicts_[0]); }

   private:
    friend class SightCache;
    static constexpr std::size_t kPerWord = 16;  // two bits a cell: seen, hidden; neither: not known
    std::vector<std::atomic<std::uint32_t>> verdicts_;
  };
  /// `point`: of the grid.
  std::shared_ptr<Row> rowOf(const glm::uvec3& point);
  /// Whether nothing lies between `place`, to which the row belongs, and the cell.
  bool sees(Row& row, const glm::vec3& place, std::uint32_t cell) const;

  std::uint64_t bytes() const;  ///< of the rows that are kept

 private:
  const lod::patch::ProxySight& sight_;
  const float clearance_;
  mutable std::mutex mutex_;
  repository::LruCache<std::uint64_t, std::shared_ptr<Row>> rows_;  // by the code of their point; guarded by mutex_
};

}  // namespace plan
