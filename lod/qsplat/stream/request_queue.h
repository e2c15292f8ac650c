#pragma once
// A table of which blocks of a qsplat.lgq are in memory, two bits a block (Rusinkiewicz and Levoy 2001, section 3.3),
// and the blocks that a frame lacks, the most urgent first (section 3.4).
#include <array>
#include <cstdint>
#include <vector>

#include "lod/qsplat/traverse.h"

namespace lod::qsplat {

enum class BlockState : std::uint8_t {
  kAbsent,
  kWanted,     ///< in the request queue of this frame
  kRequested,  ///< under way
  kPresent,
};

class Availability {
 public:
  /// All blocks are absent at first.
  explicit Availability(std::uint64_t blocks);

  std::uint64_t blocks() const { return blocks_; }
  /// Returns the state of a block. `number` is 0 … blocks() − 1 in all functions.
  BlockState stateOf(std::uint64_t number) const {
    return static_cast<BlockState>(words_[number / kPerWord] >> shift(number) & 3U);
  }
  void setState(std::uint64_t number, BlockState state);
  /// Returns how many blocks are in this state.
  std::uint64_t count(BlockState state) const { return counts_[static_cast<std::size_t>(state)]; }
  /// Returns the first absent block from `from` on; blocks() when there is none.
  std::uint64_t nextAbsent(std::uint64_t from) const;

 private:
  static constexpr std::uint64_t kPerWord = 32;
  static unsigned shift(std::uint64_t number) { return 2 * static_cast<unsigned>(number % kPerWord); }
  std::uint64_t blocks_;
  std::vector<std::uint64_t> words_;
  std::array<std::uint64_t, 4> counts_{};
};

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
