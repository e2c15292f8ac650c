#pragma once
// Proven bounds of the distance from the source surface, carried along per triangle while a mesh is simplified again
// and again.
//
// The distance to a convex set is a convex function. So the largest distance from a convex piece of one surface to one
// triangle of the other is met at a corner of the piece. Each triangle is laid on the other surface: cut along the
// walls over the edges there, and the parts beyond a wall walk on to the neighbour. Which triangle a walk starts from
// (the history of collapses says) changes how tight the bound is, never that it is one.
//
// What a piece adds is added to what its own triangle carries, point by point (triangle inequality). So large errors of
// different places never add up.
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <vector>

#include "lod/patch/builder/facet_surface.h"
#include "lod/patch/builder/simplify.h"

namespace lod::patch::builder {

/// Per triangle, in units of the positions. Every source point is assigned to some triangle and at most its `toward`
/// from it; every point of a triangle is at most its `from` from the source surface. The colours at both ends of what
/// is measured so differ by at most `color` (0 … 255 a channel, Euclidean). Empty: all zero.
struct SurfaceError {
  std::vector<float> toward;
  std::vector<float> from;
  std::vector<float> color;
};

/// A triangle of the surface before, with a place that came out so far off, or that a place after is so far off from:
/// in units of the positions, what was carried included.
struct Outlier {
  std::uint32_t triangle = 0;
  float error = 0.0F;
};

/// The bounds of `after`, which simplifyGroup made of `before`, rounding included. Distances below `negligible` are not
/// looked into. Triangles that stayed as they were carry on what they had. Both surfaces have triangles, and both
/// colours or neither. Of `before` facets and boxes are made as they are needed.
/// `outliers`: the triangles of `before` that come out off by more than `precise`, and all that do by nearly as much as
/// the vertices need; several times some. Above `precise` bounds are as tight as can be, which takes time; else those
/// up to what the vertices need are not tried to be lowered, so that triangles may be outliers for nothing.
SurfaceError carryError(FacetSurface& before, const SurfaceError& before_error, const SurfaceView& after,
                        const CollapseHistory& history, float negligible, std::vector<Outlier>& outliers,
                        float precise = std::numeric_limits<float>::infinity());

/// A distance or a difference of colours in two bytes, rounded up by at most 0.05 % from 1/16 to 2^22; less counts as
/// 1/16, 0 stays 0. No two points of a lattice (21 bits) are farther from each other than 2^22.
std::uint16_t errorCode(float error);
float errorOfCode(std::uint16_t code);

}  // namespace lod::patch::builder
