#include "lod/qsplat/stream/availability.h"

namespace lod::qsplat {

Availability::Availability(std::uint64_t blocks) : blocks_(blocks), words_((blocks + kPerWord - 1) / kPerWord, 0) {
  counts_[static_cast<std::size_t>(BlockState::kAbsent)] = blocks;
}

void Availability::setState(std::uint64_t number, BlockState state) {
  --counts_[static_cast<std::size_t>(stateOf(number))];
  ++counts_[static_cast<std::size_t>(state)];
  std::uint64_t& word = words_[number / kPerWord];
  word = (word & ~(std::uint64_t{3} << shift(number))) | static_cast<std::uint64_t>(state) << shift(number);
}

std::uint64_t Availability::nextAbsent(std::uint64_t from) const {
  constexpr std::uint64_t kAllPresent = ~std::uint64_t{0};
  while (from < blocks_ && stateOf(from) != BlockState::kAbsent)
    from = from % kPerWord == 0 && words_[from / kPerWord] == kAllPresent ? from + kPerWord : from + 1;
  return from < blocks_ ? from : blocks_;
}

}  // namespace lod::qsplat
