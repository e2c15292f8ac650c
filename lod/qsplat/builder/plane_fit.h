#pragma once
// A plane through points near each other, and how far a point's Voronoi cell reaches in it. Private to
// lod/build/qsplat.
#include <glm/glm.hpp>
#include <span>

namespace lod::qsplat::builder {

/// Unit normal of the plane through the points that leaves the least sum of squares, of either sign; +z where they lie
/// on a line or at one place.
glm::dvec3 planeNormal(std::span<const glm::dvec3> points);

/// How far the Voronoi cell of `center` among `others` reaches, all seen along `normal`; at most `most`.
double cellReach(const glm::dvec3& center, const glm::dvec3& normal, std::span<const glm::dvec3> others, double most);

}  // namespace lod::qsplat::builder
