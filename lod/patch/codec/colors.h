#pragma once
// Colours of a patch: 40 levels a channel, then the reversible YCoCg transform of Malvar and Sullivan 2003 ("YCoCg-R: A
// Color Space with RGB Reversibility and Low Dynamic Range") on the levels.
#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>

#include "base/simd.h"

namespace lod::patch::codec {

/// The highest level. Forty levels are at most 3/255 off (docs/formats/patch.md, "Colours").
inline constexpr std::int32_t kMaxLevel = 39;

/// The level nearest to a channel's byte.
inline constexpr std::array<std::uint8_t, 256> kLevelOfByte = [] {
  std::array<std::uint8_t, 256> levels{};
  for (std::size_t c = 0; c < levels.size(); ++c)
    levels[c] = static_cast<std::uint8_t>((c * kMaxLevel * 2 + 255) / 510);
  return levels;
}();

/// 255 / kMaxLevel in 16-bit fixed point, rounded up, so that (level · scale + ½) >> 16 is the nearest byte.
inline constexpr std::int32_t kLevelScale = 255 * 65536 / kMaxLevel + 1;

inline std::uint8_t byteOfLevel(std::int32_t level) {
  return static_cast<std::uint8_t>((level * kLevelScale + 32768) >> 16);
}

/// The same lane by lane. Damaged bytes may decode to any level: they are clamped.
LUMIGRID_ALWAYS_INLINE base::Int4 bytesOfLevels(base::Int4 level) {
  level = level < 0 ? base::Int4{} : level;
  level = level > kMaxLevel ? base::Int4{} + kMaxLevel : level;
  return (level * kLevelScale + 32768) >> 16;
}

/// Converts RGB to YCoCg; the lanes are Y, Co, Cg, 0.
inline base::Int4 codeOfColor(const glm::u8vec4& c) {
  const std::int32_t red = kLevelOfByte[c.r], blue = kLevelOfByte[c.b];
  const std::int32_t orange = red - blue;
  const std::int32_t half = blue + (orange >> 1);
  const std::int32_t green = kLevelOfByte[c.g] - half;
  return base::Int4{half + (green >> 1), orange, green, 0};
}

/// Four colours from four codes, red in the lowest byte. Sums are unsigned, since damaged codes may wrap.
LUMIGRID_ALWAYS_INLINE base::Uint4 colorsOfCodes(base::Uint4 luma, base::Uint4 orange, base::Uint4 green,
                                                 base::Uint4 alpha) {
  using base::Int4;
  using base::Uint4;
  const auto half_of = [](Uint4 x) { return reinterpret_cast<Uint4>(reinterpret_cast<Int4>(x) >> 1); };
  const Uint4 half = luma - half_of(green);
  const Uint4 blue = half - half_of(orange);
  const auto bytes = [](Uint4 level) { return reinterpret_cast<Uint4>(bytesOfLevels(reinterpret_cast<Int4>(level))); };
  return bytes(blue + orange) | bytes(green + half) << 8 | bytes(blue) << 16 | alpha << 24;
}

}  // namespace lod::patch::codec
