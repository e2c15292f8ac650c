#pragma once
// What a traversal hands to the drawing.
#include <cstdint>
#include <glm/glm.hpp>

namespace lod::qsplat {

/// A node that is drawn as it is: 20 bytes, laid out as the GPU reads them.
struct Splat {
  glm::vec3 center;      ///< of the decoded sphere, scene-local
  float radius;          ///< of the decoded sphere, scene units: says the resolution, too
  std::uint16_t normal;  ///< code (docs/formats/qsplat.md) in bits 0 … 13, flags above
  std::uint16_t color;   ///< red 5 bits (from bit 11), green 6, blue 5, sRGB; white where the file has none

  static constexpr std::uint16_t kCode = 0x3FFF;
  static constexpr std::uint16_t kLeaf = 0x4000;     ///< nothing finer exists
  static constexpr std::uint16_t kStandIn = 0x8000;  ///< finer nodes are wanted, but their block is not here
  friend bool operator==(const Splat&, const Splat&) = default;
};
static_assert(sizeof(Splat) == 20);

inline constexpr std::uint16_t kWhite565 = 0xFFFF;

}  // namespace lod::qsplat
