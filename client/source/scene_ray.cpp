#include "client/source/scene_ray.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace client {
namespace {

constexpr double kMiss = std::numeric_limits<double>::infinity();

}  // namespace

SceneRay rayThrough(const base::Camera& camera, double x, double y) {
  const glm::dmat4 scene_from_clip = glm::inverse(glm::dmat4(camera.clip_from_eye) * glm::dmat4(camera.eye_from_scene));
  const double u = 2.0 * (x / camera.width) - 1.0;
  const double v = 1.0 - 2.0 * (y / camera.height);
  const glm::dvec4 near_point = scene_from_clip * glm::dvec4(u, v, -1.0, 1.0);
  const glm::dvec4 far_point = scene_from_clip * glm::dvec4(u, v, 1.0, 1.0);
  const glm::dvec3 origin = glm::dvec3(near_point) / near_point.w;
  return {origin, glm::normalize(glm::dvec3(far_point) / far_point.w - origin)};
}

bool meetsBox(const SceneRay& ray, const base::Aabb& box, double nearest) {
  double enter = 0.0;
  double leave = nearest;
  for (int axis = 0; axis < 3; ++axis) {
    double first = (static_cast<double>(box.min[axis]) - ray.origin[axis]) / ray.direction[axis];
    double second = (static_cast<double>(box.max[axis]) - ray.origin[axis]) / ray.direction[axis];
    if (first > second) std::swap(first, second);
    // A ray within a side's plane gives no number; the comparisons then leave the limits as they are.
    if (first > enter) enter = first;
    if (second < leave) leave = second;
  }
  return enter <= leave;
}

double distanceToTriangle(const SceneRay& ray, const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
  const glm::dvec3 ab = b - a;
  const glm::dvec3 ac = c - a;
  const glm::dvec3 across = glm::cross(ray.direction, ac);
  const double determinant = glm::dot(ab, across);
  if (determinant == 0.0) return kMiss;
  const glm::dvec3 from_a = ray.origin - a;
  const double u = glm::dot(from_a, across) / determinant;
  const glm::dvec3 turned = glm::cross(from_a, ab);
  const double v = glm::dot(ray.direction, turned) / determinant;
  if (!(u >= 0.0 && v >= 0.0 && u + v <= 1.0)) return kMiss;
  const double along = glm::dot(ac, turned) / determinant;
  return along >= 0.0 ? along : kMiss;
}

double distanceToPoint(const SceneRay& ray, const glm::dvec3& point, double radius) {
  const glm::dvec3 to_point = point - ray.origin;
  const double along = glm::dot(to_point, ray.direction);
  const bool meets = along >= 0.0 && glm::dot(to_point, to_point) - along * along <= radius * radius;
  return meets ? along : kMiss;
}

double distanceToLine(const SceneRay& ray, const glm::dvec3& a, const glm::dvec3& b, double radius) {
  // Seen along the ray, the place of the line that is nearest to it is the foot of a perpendicular.
  const auto across = [&](const glm::dvec3& v) { return v - glm::dot(v, ray.direction) * ray.direction; };
  const glm::dvec3 line = across(b - a);
  const double length_squared = glm::dot(line, line);
  const double foot = length_squared > 0.0 ? glm::dot(across(ray.origin - a), line) / length_squared : 0.0;
  return distanceToPoint(ray, glm::mix(a, b, std::clamp(foot, 0.0, 1.0)), radius);
}

void RayHit::keep(double distance) {
  if (!(distance < nearest)) return;
  const glm::vec3 point(ray.origin + distance * ray.direction);
  if (glm::dot(glm::vec3(section), point) <= section.w) nearest = distance;
}

std::optional<glm::vec3> RayHit::place() const {
  if (!std::isfinite(nearest)) return std::nullopt;
  return glm::vec3(ray.origin + nearest * ray.direction);
}

}  // namespace client
