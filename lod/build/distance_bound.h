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

#include "lod/build/simplify.h"

namespace lod::build {

struct SurfaceView {
  std::span<const glm::vec3> positions;
  std::span<const std::uint32_t> indices;  ///< 3 per triangle
};

/// Bound of the distance between `before` and what simplifyGroup made of it, `after`, in units of the positions,
/// rounding included. Distances below `negligible` are not looked into: the result is at least that, except 0 for an
/// unchanged mesh. The bound exceeds the distance by about a tenth at most, as long as the surfaces stay near each
/// other.
float distanceBound(const SurfaceView& before, const SurfaceView& after, const Simplified& history, float negligible);

}  // namespace lod::build
