#pragma once
// A table of which blocks of a qsplat.lgq are in memory, two bits a block (Rusinkiewicz and Levoy 2001, section 3.3).
#include <array>
#include <cstdint>
#include <vector>

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

}  // namespace lod::qsplat
