#include "lod/draw/near_fit.h"

#include <algorithm>
#include <array>
#include <limits>

#include "lod/view_box.h"

namespace lod::draw {
namespace {

/// The near plane lies before what is drawn by a hundredth, more than projecting rounds off.
constexpr float kShare = 0.99F;

/// A picture is taken for wider by a fiftieth, since shapes of some pixels reach into it from outside.
constexpr float kWider = 1.02F;

base::Camera widened(base::Camera camera) {
  for (int column = 0; column < 4; ++column) camera.clip_from_eye[column] /= glm::vec4(kWider, kWider, 1.0F, 1.0F);
  return camera;
}

glm::vec4 distanceAlongAxis(const glm::mat4& eye_from_scene) {
  return -glm::vec4(eye_from_scene[0][2], eye_from_scene[1][2], eye_from_scene[2][2], eye_from_scene[3][2]);
}

/// A triangle cut by up to six planes.
struct Polygon {
  std::array<glm::vec3, 9> corners;
  std::size_t size = 0;
  /// Rounding may make a corner cross a plane once more than it can; such a corner lies on it, and is left out.
  void add(const glm::vec3& corner) {
    if (size < corners.size()) corners.at(size++) = corner;
  }
};

/// Returns the part of the polygon on the plane's inner side (Sutherland and Hodgman 1974).
Polygon inside(const Polygon& polygon, const glm::vec4& plane) {
  Polygon kept;
  for (std::size_t i = 0; i < polygon.size; ++i) {
    const glm::vec3& from = polygon.corners.at(i);
    const glm::vec3& to = polygon.corners.at((i + 1) % polygon.size);
    const float before = glm::dot(plane, glm::vec4(from, 1.0F)), after = glm::dot(plane, glm::vec4(to, 1.0F));
    if (before >= 0.0F) kept.add(from);
    if ((before >= 0.0F) != (after >= 0.0F)) kept.add(glm::mix(from, to, before / (before - after)));
  }
  return kept;
}

}  // namespace

NearFit::NearFit(const base::Camera& camera)
    : camera_(camera),
      frustum_(widened(camera).clipFromScene()),
      distance_(distanceAlongAxis(camera.eye_from_scene)),
      nearest_(std::numeric_limits<float>::infinity()) {
  if (camera.orthographic()) {
    keepNear();
    return;
  }
  near_ = base::nearPlaneOf(camera).value_or(0.0F);
  corner_cosine_ = cornerCosine(widened(camera));
}

bool NearFit::keepNearest(float distance) {
  if (!(distance > near_)) return false;
  nearest_ = std::min(nearest_, distance);
  return true;
}

bool NearFit::add(const base::Aabb& box) {
  if (isKept() || !frustum_.mayOverlap(box)) return true;
  // The picture's part of the box is no nearer along the axis than the box, nor than its distance seen in a corner.
  float along_axis = std::numeric_limits<float>::infinity();
  for (int i = 0; i < 8; ++i) along_axis = std::min(along_axis, glm::dot(distance_, glm::vec4(box.corner(i), 1.0F)));
  const float distance = glm::length(glm::clamp(camera_.eye, box.min, box.max) - camera_.eye);
  return keepNearest(std::max(along_axis, corner_cosine_ * distance));
}

bool NearFit::add(const base::Sphere& sphere) {
  if (isKept()) return true;
  const float along_axis = glm::dot(distance_, glm::vec4(sphere.center, 1.0F)) - sphere.radius;
  const float distance = glm::length(sphere.center - camera_.eye) - sphere.radius;
  return keepNearest(std::max(along_axis, corner_cosine_ * distance)) || !frustum_.mayOverlap(sphere);
}

void NearFit::addTriangle(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  if (isKept()) return;
  Polygon polygon{{a, b, c}, 3};
  for (const glm::vec4& plane : frustum_.planes) polygon = inside(polygon, plane);
  for (std::size_t i = 0; i < polygon.size; ++i)
    if (!keepNearest(glm::dot(distance_, glm::vec4(polygon.corners.at(i), 1.0F)))) return keepNear();
}

base::Camera NearFit::camera() const {
  const float near_plane = kShare * nearest_;
  const glm::mat4& clip = camera_.clip_from_eye;
  // P22 + 1 is the small share of near in far, of which the matrix has rounded off some: far is taken for larger.
  const float beyond = clip[2][2] + 1.0F + 2.0F * std::numeric_limits<float>::epsilon();
  const float far_plane = beyond < 0.0F ? clip[3][2] / beyond : std::numeric_limits<float>::infinity();
  if (!(near_plane > near_ && near_plane < far_plane)) return camera_;
  const float share = near_plane / far_plane;
  base::Camera fitted = camera_;
  fitted.clip_from_eye[2][2] = -(1.0F + share) / (1.0F - share);
  fitted.clip_from_eye[3][2] = -2.0F * near_plane / (1.0F - share);
  return fitted;
}

}  // namespace lod::draw
