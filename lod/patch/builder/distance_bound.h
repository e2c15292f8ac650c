#pragma once
// Proven bounds of the distance from the source surface, carried along per triangle while a mesh is simplified again
// and again.
//
// The distance to a convex set is a convex function. So the largest distance from a convex piece of one surface to one
// triangle of the other is met at a corner of the piece. Each triangle is projected onto the other surface: it is cut
// along the walls over the edges there, and the parts beyond a wall walk on to the neighbour. The history of collapses
// tells which triangle a walk starts from; that changes how tight the bound is, never that it is one.
//
// The distance of a piece is added to what its own triangle carries, point by point (triangle inequality). So large
// errors of different places never add up.
#include <cstdint>
#include <vector>

#include "lod/patch/builder/facet_surface.h"
#include "lod/patch/builder/simplify.h"

namespace lod::patch::builder {

/// Bounds per triangle, in units of the positions. Every source point is assigned to some triangle and is at most its
/// `toward` from it; every point of a triangle is at most its `from` from the source surface. The colours at both ends
/// of these distances differ by at most `color` (0 … 255 a channel, Euclidean). Empty: all zero.
struct SurfaceError {
  std::vector<float> toward;
  std::vector<float> from;
  std::vector<float> color;
};

/// The root mean squares over the surface before of its distance from the surface after, in units of the positions, of
/// the difference of colours there (0 … 255 a channel, Euclidean), and of the distance between the ends of unit normals
/// there. Estimates: nothing is bounded by them.
struct TypicalError {
  float distance = 0.0F;
  float color = 0.0F;   ///< 0 where one surface has no colours
  float normal = 0.0F;  ///< 0 where one has no normals
};

/// The bounds of `after`, which simplifyGroup made of `before`, rounding included. Distances below `negligible` are not
/// looked into. Triangles that stayed as they were keep what they carried. Both surfaces have triangles, and both have
/// colours or neither has. Facets and boxes of `before` are computed when they are first needed. `typical`: of this
/// one simplification, without what was carried; null where nobody asks.
SurfaceError carryError(FacetSurface& before, const SurfaceError& before_error, const SurfaceView& after,
                        const CollapseHistory& history, float negligible, TypicalError* typical);

/// A distance or a difference of colours in two bytes, rounded up by at most 0.05 % from 1/16 to 2^22. Less than 1/16
/// becomes 1/16, and 0 stays 0. No two points of a lattice (21 bits) are farther from each other than 2^22.
std::uint16_t errorCode(float error);
float errorOfCode(std::uint16_t code);

}  // namespace lod::patch::builder
