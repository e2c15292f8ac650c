#pragma once
// The faces that a store lacks, from the keys that it has.
#include <cstdint>
#include <optional>
#include <vector>

#include "repository/grid.h"
#include "repository/shard.h"

namespace repository {

/// Faces that should be in a store and are not.
struct Gap {
  FaceKey first, last;      ///< both missing, and all faces of the grid between them in Morton order
  std::uint64_t faces = 0;  ///< so many
  friend bool operator==(const Gap&, const Gap&) = default;
};

/// Takes keys in ascending order and keeps what lies between them.
class GapFinder {
 public:
  /// Only faces of the shard's points are expected.
  GapFinder(const Grid& grid, const Shard& shard);
  /// A key of the grid, larger than those before it.
  void take(const FaceKey& key);
  /// All keys were taken: what is left is missing.
  void finish();
  const std::vector<Gap>& gaps() const { return gaps_; }
  std::size_t found() const { return gaps_.size(); }

 private:
  FaceKey keyAt(std::uint64_t place) const;
  std::uint64_t placeOf(const FaceKey& key);
  void missUpTo(std::uint64_t place);

  Grid grid_;
  std::uint64_t next_;  // the face that should come next, counted in Morton order
  std::uint64_t end_;
  std::optional<glm::uvec3> last_point_;
  std::uint64_t last_rank_ = 0;
  std::vector<Gap> gaps_;
};

}  // namespace repository
