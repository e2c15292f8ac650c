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
#include <limits>
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

/// A triangle of the surface before, from or to which some distance is so large: in units of the positions, with what
/// was carried.
struct Outlier {
  std::uint32_t triangle = 0;
  float error = 0.0F;
};

/// The bounds of `after`, which simplifyGroup made of `before`, rounding included. Distances below `negligible` are not
/// looked into. Triangles that stayed as they were keep what they carried. Both surfaces have triangles, and both have
/// colours or neither has. Facets and boxes of `before` are computed when they are first needed.
///
/// `outliers`: the triangles of `before` whose error is above `precise`, and all whose error is nearly as large as that
/// of some vertex; some are listed several times. Bounds above `precise` are made as tight as possible, which takes
/// time. Bounds below it are not lowered once they are within the largest error of a vertex, so without `precise` some
/// outliers are false ones.
SurfaceError carryError(FacetSurface& before, const SurfaceError& before_error, const SurfaceView& after,
                        const CollapseHistory& history, float negligible, std::vector<Outlier>& outliers,
                        float precise = std::numeric_limits<float>::infinity());

/// A distance or a difference of colours in two bytes, rounded up by at most 0.05 % from 1/16 to 2^22. Less than 1/16
/// becomes 1/16, and 0 stays 0. No two points of a lattice (21 bits) are farther from each other than 2^22.
std::uint16_t errorCode(float error);
float errorOfCode(std::uint16_t code);

}  // namespace lod::patch::builder
