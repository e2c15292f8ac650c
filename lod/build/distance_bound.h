#pragma once
// A proven upper bound of the two-sided distance (Hausdorff) between two triangle sets that lie close to each other.
//
// The distance to a convex set is a convex function. So the largest distance from a convex polygon to one triangle is
// met at a corner of the polygon, and a polygon cut into pieces, each measured against any triangle of the other
// surface, is never farther from that surface than the largest of these figures. Each source triangle is laid on a
// target triangle, cut along the walls over its edges, and the parts beyond a wall walk on to the neighbour there.
// Which triangle a walk starts from (the history of collapses says) changes how tight the bound is, never that it is
// one.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace lod::build {

struct SurfaceView {
  std::span<const glm::vec3> positions;
  std::span<const std::uint32_t> indices;  ///< 3 per triangle
};

/// Bound of the distance between `before` and `after`, in units of the positions, rounding included. Both are indexed
/// by the same vertex numbers; `survivor[v]` is the vertex of `after` that v was collapsed into (it may be without
/// triangles where a whole component vanished). 0 when the surfaces are equal. Neither may be empty.
float distanceBound(const SurfaceView& before, const SurfaceView& after, std::span<const std::uint32_t> survivor);

}  // namespace lod::build
