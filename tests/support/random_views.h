#pragma once
// Draws random cameras around a model: far and near, wide and narrow, off-axis and parallel; the same for the same
// seed.
#include <cmath>
#include <random>

#include "base/camera.h"

namespace support {

class RandomViews {
 public:
  RandomViews(unsigned seed, const base::Sphere& model, int size) : random_(seed), model_(model), size_(size) {}

  double number(double low, double high) {
    return low + (high - low) * (static_cast<double>(random_()) / 4294967296.0);
  }

  glm::dvec3 direction() {
    const double z = number(-1.0, 1.0);
    const double turn = number(0.0, 6.283185307);
    return {std::sqrt(1.0 - z * z) * std::cos(turn), std::sqrt(1.0 - z * z) * std::sin(turn), z};
  }

  /// Eyes are outside the model's sphere, 1.02 to 5 radii from its centre.
  base::Camera next() {
    const auto radius = static_cast<double>(model_.radius);
    base::ViewCamera view;
    view.position = glm::dvec3(model_.center) + direction() * radius * (1.02 + 4.0 * std::pow(number(0.0, 1.0), 3.0));
    const glm::dvec3 target = glm::dvec3(model_.center) + direction() * radius * number(0.0, 0.8);
    view.direction = glm::normalize(target - view.position);
    view.up = direction();
    view.fov_y = glm::radians(number(15.0, 110.0));
    view.width = size_;
    view.height = size_;
    if (number(0.0, 1.0) < 0.15) view.ortho_height = radius * number(0.3, 2.5);
    base::Camera camera = base::cameraForScene(view, glm::dvec3(0.0), model_);
    if (!camera.orthographic() && number(0.0, 1.0) < 0.2) {  // off-axis
      camera.clip_from_eye[2][0] += static_cast<float>(number(-0.5, 0.5));
      camera.clip_from_eye[2][1] += static_cast<float>(number(-0.5, 0.5));
    }
    return camera;
  }

 private:
  std::mt19937 random_;
  base::Sphere model_;
  int size_;
};

}  // namespace support
