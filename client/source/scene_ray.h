#pragma once
// Finds the surface under the pointer: the ray through a place of the picture, and where it meets what is drawn.
#include <glm/glm.hpp>
#include <limits>
#include <optional>

#include "base/camera.h"
#include "base/geometry.h"

namespace client {

/// The ray of scene-local points that are seen at a place in the picture, from the near plane on.
struct SceneRay {
  glm::dvec3 origin{0.0};
  glm::dvec3 direction{0.0};  ///< unit
};
/// `x` and `y`: pixels from the upper left corner.
SceneRay rayThrough(const base::Camera& camera, double x, double y);

/// Returns whether the ray meets the box nearer than `nearest`, scene units.
bool meetsBox(const SceneRay& ray, const base::Aabb& box, double nearest);
/// Returns the distance at which the ray meets the triangle, infinity where it does not (Möller and Trumbore 1997).
double distanceToTriangle(const SceneRay& ray, const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c);
/// Returns the distance at which the ray passes the point by at most `radius`, infinity where it does not.
double distanceToPoint(const SceneRay& ray, const glm::dvec3& point, double radius);
/// The same of the line from `a` to `b`, which may be one point.
double distanceToLine(const SceneRay& ray, const glm::dvec3& a, const glm::dvec3& b, double radius);

/// The nearest surface that a ray meets.
struct RayHit {
  SceneRay ray;
  glm::vec4 section = base::kNoSection;                      ///< surfaces beyond it are cut away
  double nearest = std::numeric_limits<double>::infinity();  ///< distance along the ray, scene units

  /// Keeps the distance where it is nearer, unless the place is cut away.
  void keep(double distance);
  /// Scene-local; nullopt where the ray has met nothing.
  std::optional<glm::vec3> place() const;
};

}  // namespace client
