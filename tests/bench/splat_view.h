#pragma once
// Views that benches of splats take.
#include <cmath>
#include <glm/glm.hpp>

#include "base/camera.h"

namespace bench {

/// Returns a camera `radii` of the model's sphere away from its middle, z up, 16 : 9 and `width` pixels wide. Radians:
/// `turn` around z, `pitch` above the horizon, `look` to the side of the middle.
inline base::Camera orbitCamera(const base::Sphere& model, double turn, double pitch, double radii, int width,
                                double look = 0.0) {
  const glm::dvec3 away(std::cos(turn) * std::cos(pitch), std::sin(turn) * std::cos(pitch), std::sin(pitch));
  const double c = std::cos(look), s = std::sin(look);
  base::ViewCamera view;
  view.position = glm::dvec3(model.center) + radii * static_cast<double>(model.radius) * away;
  view.direction = {-c * away.x + s * away.y, -s * away.x - c * away.y, -away.z};
  view.up = {0, 0, 1};
  view.width = width;
  view.height = width * 9 / 16;
  return base::cameraForScene(view, glm::dvec3(0.0), model);
}

}  // namespace bench
