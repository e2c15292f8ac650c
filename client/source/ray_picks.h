#pragma once
// Rays at the full-resolution surface of a hierarchy whose records and blocks come piece by piece: what measuring on a
// published scene asks for. lod/patch/ray_cast finds; this says what has to be fetched, one ray after the other, and
// keeps the blocks that the ray in hand needs until it is answered.
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/bytes.h"
#include "client/source/pick_answer.h"
#include "lod/patch/ray_cast.h"

namespace client {

struct AnsweredPick {
  std::uint32_t id = 0;
  PickAnswer answer;  ///< a hit's place is scene-local where RayPicks tells it, world where a source does
};

class RayPicks {
 public:
  static constexpr std::size_t kMaxQueue = 64;
  /// Groups that are asked for at a time, the nearest: those behind a hit are not needed.
  static constexpr std::size_t kGroupsAhead = 4;
  /// Compressed blocks that one ray may need at a time; beyond, its answer is kUnknown.
  static constexpr std::size_t kMaxBytes = 8'000'000;

  /// How a group's record stands after an attempt to take it into the hierarchy.
  enum class RecordStatus : std::uint8_t { kHere, kMissing, kBroken };
  using ReadRecord = std::function<RecordStatus(std::uint32_t group)>;

  /// `ray` scene-local. With kMaxQueue rays waiting the answer is kUnknown at once.
  void addRay(std::uint32_t id, const lod::patch::Ray& ray);
  bool waiting() const { return !rays_.empty(); }
  /// A block that came; taken only while a ray waits.
  void keepBlock(std::uint32_t group, base::ByteView block);
  /// Casts as far as what is here leads. `elsewhere`: blocks that somebody else holds. Call again when something came.
  void castWaiting(const lod::patch::Hierarchy& hierarchy, const lod::patch::BlockSource& elsewhere,
                   const ReadRecord& read_record);
  /// Records or blocks of these groups bring the first ray further, the nearest first.
  const std::vector<std::uint32_t>& needed() const { return needed_; }
  /// Nobody will ever say: the scene is gone.
  void giveUp();
  std::vector<AnsweredPick> takeAnswers();
  /// What was damaged, the newest such thing, one line; else empty.
  const std::string& problem() const { return problem_; }

 private:
  struct WaitingRay {
    std::uint32_t id = 0;
    lod::patch::Ray ray;
  };
  void finishFirst(const PickAnswer& found);

  std::deque<WaitingRay> rays_;  ///< the first is worked on
  std::vector<std::uint32_t> needed_;
  std::unordered_map<std::uint32_t, base::Bytes> blocks_;
  std::size_t block_bytes_ = 0;
  std::vector<AnsweredPick> answered_;
  std::string problem_;
};

}  // namespace client
