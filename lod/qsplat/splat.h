#pragma once
// A splat as a traversal finds it and the renderer draws it.
#include <cstdint>
#include <glm/glm.hpp>

namespace lod::qsplat {

/// A node that is drawn without its children: 20 bytes, laid out as the GPU reads them.
struct Splat {
  glm::vec3 center;      ///< centre of the decoded sphere, scene-local
  float radius;          ///< radius of the decoded sphere, scene units
  std::uint16_t normal;  ///< normal code in bits 0 … 13, flags above
  std::uint16_t color;   ///< red 5 bits (from bit 11), green 6, blue 5, sRGB; white where the file has none

  static constexpr std::uint16_t kLeaf = 0x4000;     ///< the tree has nothing finer here
  static constexpr std::uint16_t kStandIn = 0x8000;  ///< drawn in place of finer nodes whose block is missing
  friend bool operator==(const Splat&, const Splat&) = default;
};
static_assert(sizeof(Splat) == 20);

inline constexpr std::uint16_t kWhite565 = 0xFFFF;

}  // namespace lod::qsplat
