#include "lod/ingest/morton.h"

#include <bit>
#include <span>
#include <utility>

namespace lod::ingest {

void radixSort(std::vector<KeyedIndex>& items, std::uint32_t key_bits) {
  constexpr std::uint32_t kMaxDigitBits = 11;
  if (items.size() < 256) {
    std::stable_sort(items.begin(), items.end(),
                     [](const KeyedIndex& a, const KeyedIndex& b) { return a.key < b.key; });
    return;
  }
  // Bits above the highest in which any two keys differ need no sorting.
  std::uint64_t differ = 0;
  for (const KeyedIndex& k : items) differ |= k.key ^ items[0].key;
  key_bits = std::min(key_bits, static_cast<std::uint32_t>(std::bit_width(differ)));
  if (key_bits == 0) return;
  // All digits have the same length, and are counted in one pass.
  const std::uint32_t digits = (key_bits + kMaxDigitBits - 1) / kMaxDigitBits;
  const std::uint32_t digit_bits = (key_bits + digits - 1) / digits;
  const std::uint64_t mask = (std::uint64_t{1} << digit_bits) - 1;
  std::vector<std::uint32_t> starts(std::size_t{digits} << digit_bits, 0);
  for (const KeyedIndex& k : items)
    for (std::uint32_t d = 0; d < digits; ++d)
      ++starts[(std::size_t{d} << digit_bits) + (k.key >> (d * digit_bits) & mask)];
  std::vector<KeyedIndex> other(items.size());
  for (std::uint32_t d = 0; d < digits; ++d) {
    const std::span<std::uint32_t> start = std::span(starts).subspan(std::size_t{d} << digit_bits, mask + 1);
    std::uint32_t sum = 0;
    for (std::uint32_t& s : start) sum += std::exchange(s, sum);
    const std::uint32_t shift = d * digit_bits;
    for (const KeyedIndex& k : items) other[start[k.key >> shift & mask]++] = k;
    items.swap(other);
  }
}

}  // namespace lod::ingest
