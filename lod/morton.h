#pragma once
// Morton codes of lattice points (Morton 1966).
#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>

namespace lod {

/// Three coordinates of this many bits fill a 63-bit Morton code.
inline constexpr std::uint32_t kMaxLatticeBits = 21;

// For each byte its bits with two zero bits before each.
inline constexpr std::array<std::uint32_t, 256> kSpreadBytes = [] {
  std::array<std::uint32_t, 256> spread{};
  for (std::uint32_t byte = 0; byte < spread.size(); ++byte)
    for (std::uint32_t bit = 0; bit < 8; ++bit) spread[byte] |= (byte >> bit & 1U) << (3 * bit);
  return spread;
}();

// The inverse: gathers every third bit, from the lowest on.
inline std::uint64_t gatherBits(std::uint64_t x) {
  x &= 0x1249249249249249;
  x = (x | x >> 2) & 0x10c30c30c30c30c3;
  x = (x | x >> 4) & 0x100f00f00f00f00f;
  x = (x | x >> 8) & 0x1f0000ff0000ff;
  x = (x | x >> 16) & 0x1f00000000ffff;
  return (x | x >> 32) & 0x1fffff;
}

/// Interleaves the bits of x, y and z, x lowest. Coordinates are 0 … 2^21 − 1.
inline std::uint64_t mortonCode(const glm::ivec3& q) {
  const auto bits = [&q](int first, int mask) -> std::uint64_t {
    const auto spread = [&](int x) { return kSpreadBytes[static_cast<std::size_t>(x >> first & mask)]; };
    return spread(q.x) | spread(q.y) << 1 | spread(q.z) << 2;
  };
  return bits(0, 255) | bits(8, 255) << 24 | bits(16, 31) << 48;
}
inline glm::ivec3 mortonPoint(std::uint64_t code) {
  return {static_cast<int>(gatherBits(code)), static_cast<int>(gatherBits(code >> 1)),
          static_cast<int>(gatherBits(code >> 2))};
}

}  // namespace lod
