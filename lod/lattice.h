#pragma once
// The lattice on which all positions of a scene lie.
#include <glm/glm.hpp>

namespace lod {

/// Positions are origin + step · q for integers q. Equal lattice points give bit-equal floats everywhere, so shared
/// borders cannot open.
struct Lattice {
  glm::dvec3 origin{0.0};  ///< relative to the scene's origin
  double step = 1.0;       ///< scene units, > 0
  glm::vec3 position(const glm::ivec3& q) const { return glm::vec3(origin + step * glm::dvec3(q)); }
  /// The largest distance between a source point and its lattice point is half a cell's diagonal.
  double positionError() const { return 0.5 * 1.7320508075688772 * step; }
};

}  // namespace lod
