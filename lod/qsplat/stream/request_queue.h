#pragma once
// What a frame would like to have, the most urgent first (Rusinkiewicz and Levoy 2001, section 3.4).
#include <cstdint>
#include <vector>

#include "lod/qsplat/stream/availability.h"
#include "lod/qsplat/traverse.h"

namespace lod::qsplat {

/// Blocks that stand side by side in the file.
struct BlockRun {
  std::uint64_t first = 0;
  std::uint64_t count = 0;
  friend bool operator==(const BlockRun&, const BlockRun&) = default;
};

class RequestQueue {
 public:
  /// `availability` outlives it; its kWanted blocks are those in the queue.
  explicit RequestQueue(Availability& availability) : availability_(availability) {}

  /// Before every frame: what no frame wants any more is not asked for.
  void clear();
  /// What is under way, or here, is left out. Each block once a frame.
  void add(const WantedBlock& wanted);
  bool empty() const { return availability_.count(BlockState::kWanted) == 0; }

  /// Takes the most urgent block out, with those of its neighbours in the file that are in the queue and no matter of
  /// another magnitude (100 000: outside of the lens that it is within): at most `most` together. They are kRequested
  /// then. Count 0: the queue is empty, or `most` is 0.
  BlockRun take(std::uint64_t most);

 private:
  void order();
  bool joins(std::uint64_t number, float urgent) const;

  Availability& availability_;
  std::vector<WantedBlock> heap_;       ///< with blocks that went as neighbours of others
  std::vector<WantedBlock> by_number_;  ///< the same when ordered_
  bool ordered_ = false;
};

}  // namespace lod::qsplat
