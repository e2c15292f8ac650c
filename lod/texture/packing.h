#pragma once
// Packs rectangles into pages. Private to lod/texture.
#include <glm/glm.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace lod::texture {

struct PackedRectangle {
  std::uint32_t index = 0;  ///< in the list that was given
  glm::ivec2 place{0};      ///< its least corner
};

struct PackedPage {
  glm::ivec2 size{0};
  std::vector<PackedRectangle> rectangles;
};

/// Packs all rectangles, whose sides are 1 … max_side, into pages as small as can be found. Sides of pages are
/// multiples of `multiple`, which divides max_side. One page is filled to max_side before the next is begun.
std::vector<PackedPage> packRectangles(std::span<const glm::ivec2> sizes, int max_side, int multiple);

}  // namespace lod::texture
