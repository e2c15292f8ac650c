#pragma once
// Charts: triangles that hang together in a picture. Private to lod/texture.
#include <glm/glm.hpp>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "lod/texture/page.h"

namespace lod::texture {

/// A triangle whose corners are rounded to steps: texels of the picture × kCornerSteps. From here on all is integers,
/// so that triangles that were not quite at the same place share their corners.
struct StepTriangle {
  std::uint16_t triangle = 0;
  std::array<glm::ivec2, 3> corners{};
};

/// A chart with the rectangle of whole texels around it, at least 1 × 1.
struct Chart {
  std::vector<StepTriangle> triangles;
  glm::ivec2 min{0}, max{0};  ///< texels of the picture, max excluded

  glm::ivec2 size() const { return max - min; }
};

/// Rounds the triangles, without those that makePages() leaves out.
std::vector<StepTriangle> roundTriangles(std::span<const PictureTriangle> triangles);

/// Groups triangles that share an edge with the same two ends. Charts stand in the order of their first triangles.
std::vector<Chart> findCharts(std::span<const StepTriangle> triangles);

/// Takes charts that are longer than the picture apart: each of their triangles moves by whole pictures into the first
/// repetition, as far as its middle goes, and they are grouped anew. A floor of a thousand equal tiles so takes the
/// texels of one.
std::vector<Chart> foldRepetitions(std::vector<Chart> charts, const glm::ivec2& picture);

/// Disjoint sets: the set that `item` belongs to is named by its least member, which is its own parent. Paths are
/// halved on the way.
std::uint32_t setOf(std::vector<std::uint32_t>& parents, std::uint32_t item);

}  // namespace lod::texture
