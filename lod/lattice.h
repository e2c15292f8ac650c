#pragma once
// The lattice of whole numbers that all positions of a scene lie on.
#include <glm/glm.hpp>

namespace lod {

/// The scene's quantisation lattice: position = origin + step · q, q integer. `origin` is relative to the scene's
/// double origin. Equal lattice points give bit-equal floats everywhere, so shared borders cannot open.
struct Lattice {
  glm::dvec3 origin{0.0};  ///< scene-local
  double step = 1.0;       ///< scene units, > 0
  glm::vec3 position(const glm::ivec3& q) const { return glm::vec3(origin + step * glm::dvec3(q)); }
  /// Largest distance between a source point and its lattice point: half a cell's diagonal.
  double positionError() const { return 0.5 * 1.7320508075688772 * step; }
};

}  // namespace lod
