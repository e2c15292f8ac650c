#pragma once
// Residuals, the differences between values and their predictions, as bytes. A plane holds one residual per vertex, in
// groups of 16: Rice codes whose width changes from group to group.
//
// The low bits of each number (as many as the group's width) lie side by side in whole bytes. The rest of the number
// lies in unary in a stream of its own, so that a reader need not wait for one to find the other. Widths take four bits
// a group, or two where nearly all lie within a span of four. docs/formats/patch.md, "Planes", defines every bit.
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "base/simd.h"
#include "lod/patch/codec.h"

namespace lod::patch::codec {

using base::Float4;
using base::Int4;
using base::Uint4;

inline constexpr std::size_t kGroup = 16;
/// This width stands for whole 32-bit numbers and no unary bits.
inline constexpr std::uint32_t kRawWidth = 15;
/// The most unary bits of a group. One unaligned load of eight bytes yields at least 57 bits from any bit on.
inline constexpr std::uint32_t kMaxUnary = 56;
/// A plane begins with its count of unary bytes in 15 bits. This bit above them says that widths have two bits each,
/// relative to a minimum in the next byte.
inline constexpr std::uint32_t kNarrowWidths = 0x8000;
inline constexpr std::uint32_t kNarrowSpan = 4;
static_assert((kMaxPatchVertices + kGroup) / kGroup * kMaxUnary / 8 < kNarrowWidths);

constexpr std::size_t groupsOf(std::size_t count) {
  return (count + kGroup - 1) / kGroup;
}

/// Bytes of a group's low bits.
constexpr std::size_t lowBytes(std::uint32_t width) {
  return width == kRawWidth ? 64 : 2 * std::size_t{width};
}

// Residuals are stored as 2 d for d ≥ 0, else −2 d − 1, so that small ones of either sign are small numbers.
inline std::uint32_t zigzag(std::int32_t x) {
  return (static_cast<std::uint32_t>(x) << 1) ^ static_cast<std::uint32_t>(x >> 31);
}
LUMIGRID_ALWAYS_INLINE Uint4 zigzag(Uint4 x) {
  return x << 1 ^ reinterpret_cast<Uint4>(reinterpret_cast<Int4>(x) >> 31);
}
inline std::uint32_t unzigzag(std::uint32_t x) {
  return (x >> 1) ^ (0U - (x & 1U));
}

inline std::uint64_t load64(const std::uint8_t* at) {
  std::uint64_t word = 0;
  std::memcpy(&word, at, sizeof(word));
  return word;
}
inline std::uint32_t load32(const std::uint8_t* at) {
  std::uint32_t word = 0;
  std::memcpy(&word, at, sizeof(word));
  return word;
}
inline void store64(std::uint8_t* at, std::uint64_t word) {
  std::memcpy(at, &word, sizeof(word));
}

}  // namespace lod::patch::codec
