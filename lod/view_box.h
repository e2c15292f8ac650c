#pragma once
// Boxes as a view sees them.
#include <cmath>
#include <glm/glm.hpp>

#include "base/camera.h"
#include "base/geometry.h"

namespace lod {

/// The least cosine of the angle between the viewing direction and a ray of a perspective picture, off-axis too.
inline float cornerCosine(const base::Camera& camera) {
  const glm::mat4& m = camera.clip_from_eye;
  const float x = (1.0F + std::abs(m[2][0])) / m[0][0];
  const float y = (1.0F + std::abs(m[2][1])) / m[1][1];
  return 1.0F / std::sqrt(1.0F + x * x + y * y);
}

/// Whether a camera's section (base::Camera) has cut away all of a box, or of a sphere.
inline bool isBeyond(const glm::vec4& section, const base::Aabb& box) {
  const glm::vec3 n(section);
  const glm::vec3 least(n.x > 0.0F ? box.min.x : box.max.x, n.y > 0.0F ? box.min.y : box.max.y,
                        n.z > 0.0F ? box.min.z : box.max.z);
  return glm::dot(n, least) > section.w;
}

inline bool isBeyond(const glm::vec4& section, const base::Sphere& sphere) {
  return glm::dot(glm::vec3(section), sphere.center) > section.w + sphere.radius;
}

/// The depth of the box's centre behind the eye's plane, by which boxes are drawn front to back; 0 for a camera with
/// NaN in it, so that orders stay orders.
inline float depthOf(const base::Camera& camera, const base::Aabb& box) {
  const float depth = -(camera.eye_from_scene * glm::vec4(box.center(), 1.0F)).z;
  return std::isnan(depth) ? 0.0F : depth;
}

}  // namespace lod
