#pragma once
// Finds the texels that triangles need. Private to lod/texture.
#include <glm/glm.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

namespace lod::texture {

/// One byte a texel.
struct MaskView {
  std::uint8_t* texels = nullptr;
  std::ptrdiff_t stride = 0;  ///< bytes from a row to the next
  int width = 0, height = 0;

  std::uint8_t* row(int y) const { return texels + y * stride; }
};

/// A bilinear look-up in a triangle reads the texels whose centres are less than this from it, in x and in y.
inline constexpr double kLookUpReach = 1.0;
/// Texels of which more than an edge lies in the triangle. Points, and lines between texels, have none.
inline constexpr double kInsideReach = 0.5 - 1.0 / 1024.0;

/// Sets to 1 all texels of the mask whose centres are at most `reach` from the triangle, in x and in y. Texel (0, 0)
/// covers 0 … 1.
void coverTriangle(const std::array<glm::dvec2, 3>& corners, double reach, const MaskView& mask);

}  // namespace lod::texture
