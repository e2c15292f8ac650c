#pragma once
// The blocks that a frame lacks, the most urgent first (Rusinkiewicz and Levoy 2001, section 3.4).
#include <cstdint>
#include <vector>

#include "lod/qsplat/stream/availability.h"
#include "lod/qsplat/traverse.h"

namespace lod::qsplat {

/// Consecutive blocks of the file.
struct BlockRun {
  std::uint64_t first = 0;
  std::uint64_t count = 0;
  friend bool operator==(const BlockRun&, const BlockRun&) = default;
};

class RequestQueue {
 public:
  /// `availability` must outlive the queue; its kWanted blocks are those in the queue.
  explicit RequestQueue(Availability& availability) : availability_(availability) {}

  /// Empties the queue. Called before every frame, so that blocks no frame wants any more are not requested.
  void clear();
  /// Adds a block unless it is present or requested already. Each block may be added once a frame.
  void add(const WantedBlock& wanted);
  bool empty() const { return availability_.count(BlockState::kWanted) == 0; }

  /// Takes out the most urgent block, together with its neighbours in the file that are in the queue and nearly as
  /// urgent (not those outside of a lens that it is seen through): at most `max_blocks`. They become kRequested. The
  /// count is 0 when the queue is empty or `max_blocks` is 0.
  BlockRun takeRun(std::uint64_t max_blocks);

 private:
  void sort();
  bool mayJoin(std::uint64_t number, float priority) const;

  Availability& availability_;
  std::vector<WantedBlock> heap_;       ///< may still contain blocks that were taken as neighbours of others
  std::vector<WantedBlock> by_number_;  ///< the same blocks by number, valid while sorted_
  bool sorted_ = false;
};

}  // namespace lod::qsplat
