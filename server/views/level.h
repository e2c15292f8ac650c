#pragma once
// A level direction to begin with, where a scene only says what is up.
#include <cmath>
#include <glm/glm.hpp>

namespace server {

/// A unit vector perpendicular to `up`, a unit vector.
inline glm::dvec3 levelDirection(const glm::dvec3& up) {
  const glm::dvec3 other = std::abs(up.x) < 0.9 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  return glm::normalize(glm::cross(up, other));
}

}  // namespace server
