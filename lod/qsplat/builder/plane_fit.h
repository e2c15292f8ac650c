#pragma once
// Fits a plane to points near each other, and measures how far a point's Voronoi cell reaches in it.
#include <glm/glm.hpp>
#include <span>

namespace lod::qsplat::builder {

/// The unit normal of the least-squares plane through the points, of either sign; +z where they lie on a line or at one
/// place.
glm::dvec3 planeNormal(std::span<const glm::dvec3> points);

/// The distance from `center` to the farthest corner of its Voronoi cell among `others`, projected along `normal`; at
/// most `max_reach`.
double cellReach(const glm::dvec3& center, const glm::dvec3& normal, std::span<const glm::dvec3> others,
                 double max_reach);

}  // namespace lod::qsplat::builder
