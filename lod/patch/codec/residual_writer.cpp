#include "lod/patch/codec/residual_writer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "lod/patch/codec/residuals.h"

namespace lod::patch::codec {
namespace {

std::uint32_t sumOfLanes(Uint4 x) {
  x += __builtin_shufflevector(x, x, 2, 3, 0, 1);
  return x[0] + x[1];
}

// The sixteen numbers of a group, and what they cost.
class NumberGroup {
 public:
  explicit NumberGroup(const std::uint32_t* numbers) { std::memcpy(fours_, numbers, sizeof(fours_)); }

  // The width that takes fewest bits among those near the logarithm of the mean.
  std::uint32_t bestWidth() const {
    // Halves are summed apart, since their sums cannot overflow.
    const Uint4 low = (fours_[0] & 0xFFFFU) + (fours_[1] & 0xFFFFU) + (fours_[2] & 0xFFFFU) + (fours_[3] & 0xFFFFU);
    const Uint4 high = (fours_[0] >> 16) + (fours_[1] >> 16) + (fours_[2] >> 16) + (fours_[3] >> 16);
    const std::uint64_t sum = sumOfLanes(low) + (std::uint64_t{sumOfLanes(high)} << 16);
    auto width = static_cast<std::uint32_t>(std::bit_width(sum / kGroup));
    width = width > 2 ? width - 2 : 0;
    std::uint32_t best = kRawWidth;
    std::uint32_t min_bits = kRawBits;
    for (; width < kRawWidth; ++width) {
      // No number is above sixteen times the mean, so the sums of what is above this many low bits are small.
      const std::uint32_t bits = bitsAt(width);
      if (bits == kImpossible) continue;
      if (bits >= min_bits) break;  // from here on more low bits only cost more
      min_bits = bits;
      best = width;
    }
    return best;
  }

  // Bits that the group takes at that width; kImpossible if it would have more than kMaxUnary unary ones.
  static constexpr std::uint32_t kImpossible = 1U << 20;
  std::uint32_t bitsAt(std::uint32_t width) const {
    if (width == kRawWidth) return kRawBits;
    const Uint4 above = (fours_[0] >> width) + (fours_[1] >> width) + (fours_[2] >> width) + (fours_[3] >> width);
    const std::uint32_t unary = kGroup + sumOfLanes(above);
    return unary > kMaxUnary ? kImpossible : unary + static_cast<std::uint32_t>(kGroup) * width;
  }

 private:
  static constexpr std::uint32_t kRawBits = 32 * kGroup;
  Uint4 fours_[kGroup / 4];
};

// Writes the low bits of a group side by side: 2 · width bytes. The eight bytes behind them are overwritten.
void storeLowBits(const std::uint32_t* group, std::uint32_t width, std::uint8_t* to) {
  const std::uint64_t mask = (std::uint64_t{1} << width) - 1;
  const auto four = [&](const std::uint32_t* v) {
    return (v[0] & mask) | (v[1] & mask) << width | (v[2] & mask) << (2 * width) | (v[3] & mask) << (3 * width);
  };
  // Four numbers take a whole number of bytes, or half a byte more: that half goes before the next four.
  const std::uint32_t whole = width / 2;
  const std::uint32_t odd = 4 * (width % 2);
  for (std::size_t i = 0; i < kGroup; i += 8, to += width) {
    const std::uint64_t first = four(group + i);
    store64(to, first);
    store64(to + whole, (odd != 0 ? first >> (8 * whole) : 0) | four(group + i + 4) << odd);
  }
}

}  // namespace

ResidualWriter::ResidualWriter(std::size_t count)
    : widths_(count / kGroup), low_(count / kGroup * lowBytes(kRawWidth) + 8), unary_(count / 2 + 16) {}

void ResidualWriter::write(base::ByteWriter& out, std::span<const std::uint32_t> numbers) {
  const std::size_t groups = numbers.size() / kGroup;
  const std::uint32_t min_width = chooseWidths(numbers, groups);
  std::uint8_t* low = low_.data();
  std::size_t bit = 0;
  unary_[0] = 0;
  for (std::size_t g = 0; g < groups; ++g) {
    const std::uint32_t* group = numbers.data() + g * kGroup;
    const std::uint32_t width = widths_[g];
    if (width == kRawWidth) {
      std::memcpy(low, group, lowBytes(width));
    } else {
      storeLowBits(group, width, low);
      storeUnary(group, width, bit);
    }
    low += lowBytes(width);
  }

  const std::size_t unary_bytes = (bit + 7) / 8;
  out.u16(static_cast<std::uint16_t>(unary_bytes | (min_width != kRawWidth ? kNarrowWidths : 0)));
  writeWidths(out, groups, min_width);
  out.bytes(base::ByteView(low_.data(), low));
  out.bytes(base::ByteView(unary_).first(unary_bytes));
}

// Fills widths_. Returns the minimum where all widths are within kNarrowSpan of it, else kRawWidth. Narrow widths halve
// the room for widths; groups outside the span are moved into it if that costs fewer bits than are saved.
std::uint32_t ResidualWriter::chooseWidths(std::span<const std::uint32_t> numbers, std::size_t groups) {
  std::array<std::uint32_t, kRawWidth + 1> count{};
  for (std::size_t g = 0; g < groups; ++g) {
    widths_[g] = static_cast<std::uint8_t>(NumberGroup(&numbers[g * kGroup]).bestWidth());
    ++count[widths_[g]];
  }
  // The span that holds most groups.
  std::uint32_t min_width = 0;
  std::uint32_t max_inside = 0;
  for (std::uint32_t w = 0; w + kNarrowSpan <= kRawWidth; ++w) {
    const std::uint32_t inside = count[w] + count[w + 1] + count[w + 2] + count[w + 3];
    if (inside > max_inside) max_inside = inside, min_width = w;
  }

  std::size_t saved = (groups + 1) / 2 - (groups + 3) / 4;
  saved = saved > 0 ? 8 * (saved - 1) : 0;
  const auto inSpan = [&](std::uint32_t w) { return std::clamp(w, min_width, min_width + kNarrowSpan - 1); };
  std::size_t lost = 0;
  for (std::size_t g = 0; g < groups && lost <= saved; ++g) {
    if (inSpan(widths_[g]) == widths_[g]) continue;
    const NumberGroup group(&numbers[g * kGroup]);
    const std::uint32_t bits = group.bitsAt(inSpan(widths_[g]));
    if (bits == NumberGroup::kImpossible) return kRawWidth;
    lost += bits - std::min(bits, group.bitsAt(widths_[g]));
  }
  if (lost >= saved) return kRawWidth;
  for (std::size_t g = 0; g < groups; ++g) widths_[g] = static_cast<std::uint8_t>(inSpan(widths_[g]));
  return min_width;
}

// Writes what lies above the low bits in unary, from `bit` on, and moves `bit` behind it.
void ResidualWriter::storeUnary(const std::uint32_t* group, std::uint32_t width, std::size_t& bit) {
  std::uint64_t ones = 0;
  std::uint32_t place = 0;
  for (std::size_t i = 0; i < kGroup; ++i) {
    place += group[i] >> width;
    ones |= std::uint64_t{1} << place++;
  }
  std::uint8_t* to = unary_.data() + bit / 8;
  store64(to, *to | ones << (bit % 8));
  bit += place;
}

void ResidualWriter::writeWidths(base::ByteWriter& out, std::size_t groups, std::uint32_t min_width) const {
  const bool is_narrow = min_width != kRawWidth;
  if (is_narrow) out.u8(static_cast<std::uint8_t>(min_width));
  const std::size_t per_byte = is_narrow ? 4 : 2;
  for (std::size_t g = 0; g < groups; g += per_byte) {
    std::uint32_t byte = 0;
    for (std::size_t k = 0; k < per_byte && g + k < groups; ++k)
      byte |= (widths_[g + k] - (is_narrow ? min_width : 0)) << (8 / per_byte * k);
    out.u8(static_cast<std::uint8_t>(byte));
  }
}

}  // namespace lod::patch::codec
