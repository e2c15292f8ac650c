#pragma once
// Boxes, spheres, cones and frusta. Everything is in scene-local units (float32, relative to the scene's double
// origin).
#include <array>
#include <glm/glm.hpp>
#include <limits>
#include <span>

namespace base {

struct Aabb {
  glm::vec3 min{std::numeric_limits<float>::max()};
  glm::vec3 max{std::numeric_limits<float>::lowest()};

  bool empty() const { return min.x > max.x || min.y > max.y || min.z > max.z; }
  void add(const glm::vec3& p) { min = glm::min(min, p), max = glm::max(max, p); }
  void add(const Aabb& b) { min = glm::min(min, b.min), max = glm::max(max, b.max); }
  glm::vec3 center() const { return 0.5F * (min + max); }
  glm::vec3 size() const { return max - min; }
  float longest() const { return glm::max(size().x, glm::max(size().y, size().z)); }
  float diagonal() const { return glm::length(size()); }
  /// Corner 0 … 7: bit k says whether coordinate k is the largest.
  glm::vec3 corner(int i) const {
    return {(i & 1) != 0 ? max.x : min.x, (i & 2) != 0 ? max.y : min.y, (i & 4) != 0 ? max.z : min.z};
  }
  bool contains(const glm::vec3& p) const {
    return glm::all(glm::lessThanEqual(min, p)) && glm::all(glm::lessThanEqual(p, max));
  }
};

struct Sphere {
  glm::vec3 center{0.0F};
  float radius = 0.0F;
};

/// Contains every point; at most a few percent larger than the smallest one (Ritter 1990 start, then grown).
Sphere boundingSphere(std::span<const glm::vec3> points);
/// Contains every sphere, rounding included.
Sphere boundingSphere(std::span<const Sphere> spheres);

/// Normals deviate from `axis` by at most the angle whose cosine is `cos_angle`. cos_angle = −1: any direction.
struct NormalCone {
  glm::vec3 axis{0.0F, 0.0F, 1.0F};
  float cos_angle = -1.0F;
};
/// Mean axis and largest deviation of unit normals (zero vectors are passed over).
NormalCone boundingCone(std::span<const glm::vec3> unit_normals);
/// True when every surface element with a normal in the cone, anywhere in the sphere, turns its back to `eye`.
bool facesAway(const NormalCone& cone, const Sphere& bounds, const glm::vec3& eye);

/// Six planes (xyz normal pointing inside, w offset) of a clip matrix, in the space the matrix maps from.
struct Frustum {
  std::array<glm::vec4, 6> planes;
  explicit Frustum(const glm::mat4& clip_from_space);
  /// False only when the box lies outside for certain.
  bool mayOverlap(const Aabb& box) const;
  bool mayOverlap(const Sphere& sphere) const;
};

/// The unit direction `degrees` clockwise, as seen from above, from the reference of docs/formats/scene.md, "North".
/// `up` need not be unit.
glm::dvec3 northDirection(const glm::dvec3& up, double degrees);

/// The weights of a, b and c, 0 … 1, that give the point of the triangle closest to p (Ericson 2005, section 5.1.5).
glm::dvec3 closestWeightsOnTriangle(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c);
/// The point of the triangle closest to p.
glm::dvec3 closestPointOnTriangle(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c);

}  // namespace base
