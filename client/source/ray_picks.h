#pragma once
// Casts rays at the full-resolution surface of a hierarchy whose records and blocks arrive piece by piece; measuring on
// a published scene needs this. lod/patch/ray_cast finds the hit; this class says which groups have to be fetched,
// works on one ray after the other, and keeps the blocks of the ray in hand until it is answered.
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "client/source/pick_answer.h"
#include "lod/patch/ray_cast.h"

namespace client {

struct AnsweredPick {
  std::uint32_t id = 0;
  PickAnswer answer;  ///< a hit is scene-local when RayPicks returns it, and in world coordinates when a source does
};

class RayPicks {
 public:
  /// The limits here are choices. So many rays wait at most.
  static constexpr std::size_t kMaxQueue = 64;
  /// Number of groups that are requested at a time. They are the nearest ones: groups behind a hit are not needed, and
  /// fewer would take more round trips.
  static constexpr std::size_t kGroupsAhead = 4;
  /// Bytes of compressed blocks that one ray may hold. A ray that needs more is answered kUnknown.
  static constexpr std::size_t kMaxBytes = 8'000'000;

  /// State of a group's record after an attempt to read it into the hierarchy.
  enum class RecordStatus : std::uint8_t { kHere, kMissing, kBroken };
  using ReadRecord = std::function<RecordStatus(std::uint32_t group)>;

  /// Queues a ray in scene-local coordinates. With kMaxQueue rays waiting it is answered kUnknown at once.
  void addRay(std::uint32_t id, const lod::patch::Ray& ray);
  bool waiting() const { return !rays_.empty(); }
  /// Keeps a copy of a block that arrived, while a ray waits.
  void keepBlock(std::uint32_t group, base::ByteView block);
  /// Casts the waiting rays as far as the present data allow. `elsewhere` finds blocks that somebody else holds. To be
  /// called again when data arrived.
  void castWaiting(const lod::patch::Hierarchy& hierarchy, const lod::patch::BlockSource& elsewhere,
                   const ReadRecord& read_record);
  /// Groups whose records or blocks the first ray needs next, the nearest first.
  const std::vector<std::uint32_t>& needed() const { return needed_; }
  /// Answers all waiting rays with kUnknown, since the scene cannot be read.
  void giveUp();
  std::vector<AnsweredPick> takeAnswers() { return std::exchange(answered_, {}); }
  /// The newest damage that was found, one line; empty when there was none.
  const std::string& problem() const { return problem_; }

 private:
  struct WaitingRay {
    std::uint32_t id = 0;
    lod::patch::Ray ray;
  };
  void finishFirst(const PickAnswer& found);

  std::deque<WaitingRay> rays_;  ///< the first one is being cast
  std::vector<std::uint32_t> needed_;
  std::unordered_map<std::uint32_t, base::Bytes> blocks_;
  std::size_t block_bytes_ = 0;
  std::vector<AnsweredPick> answered_;
  std::string problem_;
};

}  // namespace client
