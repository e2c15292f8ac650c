#include "base/camera.h"

#include <algorithm>
#include <cmath>

namespace base {

Camera cameraFromView(const ViewCamera& view, const glm::dvec3& scene_origin, float near_plane, float far_plane) {
  const glm::dvec3 eye = view.position - scene_origin;
  Camera camera;
  camera.eye = glm::vec3(eye);
  camera.eye_from_scene = glm::mat4(glm::lookAt(eye, eye + view.direction, view.up));
  camera.clip_from_eye =
      glm::perspective(static_cast<float>(view.fov_y), static_cast<float>(view.width) / static_cast<float>(view.height),
                       near_plane, far_plane);
  camera.width = view.width;
  camera.height = view.height;
  return camera;
}

DepthRange depthRangeFor(const glm::vec3& eye, const glm::vec3& scene_center, float scene_radius) {
  const float distance = glm::length(eye - scene_center);
  const float far_plane = (distance + scene_radius) * 1.01F;
  const float near_plane = std::max((distance - scene_radius) * 0.99F, far_plane / 20000.0F);
  return {near_plane, far_plane};
}

float projectedError(float error, const glm::vec3& sphere_center, float sphere_radius, const glm::vec3& eye,
                     float pixels_per_unit_at_one, float near_plane) {
  const float distance = glm::length(sphere_center - eye) - sphere_radius;
  return error * pixels_per_unit_at_one / std::max(distance, near_plane);
}

}  // namespace base
