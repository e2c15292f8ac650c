#include "base/camera.h"

#include <algorithm>
#include <cmath>

namespace base {

glm::vec4 Camera::homogeneousEye() const {
  if (!orthographic()) return {eye, 1.0F};
  // The third row of a rotation: the axis against which the viewer looks, in the scene.
  return {glm::normalize(glm::vec3(eye_from_scene[0][2], eye_from_scene[1][2], eye_from_scene[2][2])), 0.0F};
}

bool showsSameView(const ViewCamera& a, const ViewCamera& b) {
  constexpr double kRounding = 1e-9;        // of unit vectors
  constexpr double kPlaceRounding = 1e-14;  // of coordinates, some 50 units in the last place
  const auto near = [](const glm::dvec3& u, const glm::dvec3& v) { return glm::length(u - v) <= kRounding; };
  return glm::length(a.position - b.position) <= kPlaceRounding * glm::length(a.position) &&
         near(a.direction, b.direction) && near(glm::normalize(a.up), glm::normalize(b.up)) && a.fov_y == b.fov_y &&
         a.width == b.width && a.height == b.height && a.ortho_height == b.ortho_height && a.section == b.section;
}

glm::vec4 sectionInScene(const SectionPlane& plane, const glm::dvec3& scene_origin) {
  const double length = glm::length(plane.normal);
  const double offset = plane.offset - glm::dot(plane.normal, scene_origin);
  if (!(length > 0.0) || !std::isfinite(length) || !std::isfinite(offset)) return kNoSection;
  return glm::vec4(glm::vec3(plane.normal / length), static_cast<float>(offset / length));
}

Camera cameraFromView(const ViewCamera& view, const glm::dvec3& scene_origin, float near_plane, float far_plane) {
  const glm::dvec3 eye = view.position - scene_origin;
  Camera camera;
  camera.eye = glm::vec3(eye);
  camera.eye_from_scene = glm::mat4(glm::lookAt(eye, eye + view.direction, view.up));
  const float aspect = static_cast<float>(view.width) / static_cast<float>(view.height);
  const float half_height = 0.5F * static_cast<float>(view.ortho_height);
  camera.clip_from_eye =
      view.orthographic()
          ? glm::ortho(-half_height * aspect, half_height * aspect, -half_height, half_height, near_plane, far_plane)
          : glm::perspective(static_cast<float>(view.fov_y), aspect, near_plane, far_plane);
  camera.width = view.width;
  camera.height = view.height;
  if (view.section) camera.section = sectionInScene(*view.section, scene_origin);
  return camera;
}

namespace {

float farthestDistance(const glm::vec3& eye, const Sphere& scene) {
  return (glm::length(eye - scene.center) + scene.radius) * 1.01F;
}

/// Near planes beyond this share of the far one leave 24 depth bits enough precision.
constexpr float kNearestShare = 1.0F / 20000.0F;

}  // namespace

// The matrix has m22 = (f + n) / (n − f) and m32 = 2 f n / (n − f).
std::optional<float> nearPlaneOf(const Camera& camera) {
  const float near_plane = camera.clip_from_eye[3][2] / (camera.clip_from_eye[2][2] - 1.0F);
  return std::isfinite(near_plane) && near_plane > 0.0F ? std::optional(near_plane) : std::nullopt;
}

float nearestDistance(const glm::vec3& eye, const Sphere& scene) {
  const float outside = (glm::length(eye - scene.center) - scene.radius) * 0.99F;
  return std::max(outside, kNearestShare * farthestDistance(eye, scene));
}

DepthRange depthRangeFor(const glm::vec3& eye, const Sphere& scene, float corner_cosine) {
  const float far_plane = farthestDistance(eye, scene);
  return {std::max(corner_cosine * nearestDistance(eye, scene), kNearestShare * far_plane), far_plane};
}

float cornerCosine(const ViewCamera& view) {
  const double up = std::tan(0.5 * view.fov_y);
  const double aside = up * view.width / view.height;
  return static_cast<float>(1.0 / std::sqrt(1.0 + up * up + aside * aside));
}

namespace {

/// Distance of an orthographic view's eye from the scene's centre, in radii: it stands outside the scene.
constexpr float kEyeRadii = 2.0F;
/// The same for perspective views that replace orthographic ones, at most. Their rays are within 1/32 of parallel and
/// their scales within 1/15 of each other.
constexpr double kStandInRadii = 16.0;

/// The view moved along its axis, so that the plane through `center` parallel to its picture is `distance` in front.
ViewCamera movedAlongAxis(ViewCamera view, const glm::dvec3& center, double distance) {
  view.position += (glm::dot(center - view.position, view.direction) - distance) * view.direction;
  return view;
}

}  // namespace

Camera cameraForScene(const ViewCamera& view, const glm::dvec3& scene_origin, const Sphere& scene) {
  if (!view.orthographic()) {
    const DepthRange range = depthRangeFor(glm::vec3(view.position - scene_origin), scene, cornerCosine(view));
    return cameraFromView(view, scene_origin, range.near_plane, range.far_plane);
  }
  const float radius = std::max(scene.radius, 1e-20F);
  const ViewCamera outside = movedAlongAxis(view, scene_origin + glm::dvec3(scene.center), kEyeRadii * radius);
  return cameraFromView(outside, scene_origin, (kEyeRadii - 1.01F) * radius, (kEyeRadii + 1.01F) * radius);
}

ViewCamera perspectiveStandIn(const ViewCamera& view, const glm::dvec3& scene_center, double scene_radius,
                              double min_fov) {
  if (!view.orthographic()) return view;
  // The eye is as far away as the smallest field of view allows, but always outside the scene.
  const double widest = 0.5 * view.ortho_height / std::tan(0.5 * min_fov) + scene_radius;
  const double distance =
      std::clamp(widest, static_cast<double>(kEyeRadii) * scene_radius, kStandInRadii * scene_radius);
  const double nearest = distance - scene_radius;
  ViewCamera stand_in = movedAlongAxis(view, scene_center, distance);
  stand_in.ortho_height = 0.0;
  stand_in.fov_y = std::max(min_fov, 2.0 * std::atan2(0.5 * view.ortho_height, nearest));
  return stand_in;
}

float projectedError(float error, const Sphere& sphere, const Camera& camera, float near_plane) {
  const float scale = camera.pixelsPerUnitAtOne();
  return camera.orthographic() ? error * scale
                               : projectedError(error, sphere.center, sphere.radius, camera.eye, scale, near_plane);
}

float projectedError(float error, const glm::vec3& sphere_center, float sphere_radius, const glm::vec3& eye,
                     float pixels_per_unit_at_one, float near_plane) {
  const float distance = glm::length(sphere_center - eye) - sphere_radius;
  return error * pixels_per_unit_at_one / std::max(distance, near_plane);
}

}  // namespace base
