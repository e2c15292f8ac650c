#pragma once
// The normals and heights that the Voronoi diagram of points tells (Dey and Hudson 2002, section 2).
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace lod::pmr::builder {

struct VoronoiCell {
  /// Unit vector towards the pole, the farthest vertex of the cell; its sign says nothing about inside and outside.
  glm::dvec3 normal{0.0, 0.0, 1.0};
  /// The distance of the medial axis: the lesser of the distances of the farthest vertices on either side of the
  /// tangent plane (Amenta and Bern 1999, the poles). The paper takes the greater one; with it thin plates lose their
  /// shape, since the axis that is far away outside counts, and not the one within (docs/decisions/pmr.md).
  double height = 0.0;
};

/// Triangulates the points (CGAL) and returns the cell of each. All points are different; fewer than four, or all of a
/// plane, are no trouble: far points around them close every cell, so that the pole of a cell that has no end lies
/// about in the mean direction of its open edges, as the theory has it. Heights are in the points' unit. Takes about
/// 700 bytes a point meanwhile.
std::vector<VoronoiCell> voronoiCells(std::span<const glm::dvec3> points);

}  // namespace lod::pmr::builder
