#pragma once
// Morton codes of lattice points: the bits of x, y and z in turn, x lowest.
#include <cstdint>
#include <glm/glm.hpp>

namespace lod::pmr {

/// Spreads the low 21 bits: bit i becomes bit 3 i.
inline std::uint64_t spreadBits(std::uint32_t value) {
  std::uint64_t x = value & 0x1FFFFF;
  x = (x | x << 32) & 0x001F00000000FFFF;
  x = (x | x << 16) & 0x001F0000FF0000FF;
  x = (x | x << 8) & 0x100F00F00F00F00F;
  x = (x | x << 4) & 0x10C30C30C30C30C3;
  return (x | x << 2) & 0x1249249249249249;
}
inline std::uint32_t gatherBits(std::uint64_t x) {
  x &= 0x1249249249249249;
  x = (x | x >> 2) & 0x10C30C30C30C30C3;
  x = (x | x >> 4) & 0x100F00F00F00F00F;
  x = (x | x >> 8) & 0x001F0000FF0000FF;
  x = (x | x >> 16) & 0x001F00000000FFFF;
  return static_cast<std::uint32_t>((x | x >> 32) & 0x1FFFFF);
}

/// Coordinates are 0 … 2^21 − 1.
inline std::uint64_t mortonCode(const glm::ivec3& place) {
  return spreadBits(static_cast<std::uint32_t>(place.x)) | spreadBits(static_cast<std::uint32_t>(place.y)) << 1 |
         spreadBits(static_cast<std::uint32_t>(place.z)) << 2;
}
inline glm::ivec3 placeOfMorton(std::uint64_t code) {
  return glm::ivec3(gatherBits(code), gatherBits(code >> 1), gatherBits(code >> 2));
}

}  // namespace lod::pmr
