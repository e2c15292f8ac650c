#pragma once
// Intersects a ray with a triangle without gaps between triangles: Woop, Benthin and Wald 2013, "Watertight
// Ray/Triangle Intersection", in double throughout. The corners are sheared so that the ray becomes the z axis, and
// three edge functions tell on which side of each edge it passes. Two triangles compute the function of an edge that
// they share from the same numbers, so a ray cannot slip through between them. That holds only as long as products are
// not fused with sums: files that include this are built with -ffp-contract=off. Private to lod/patch.
#include <cmath>
#include <glm/glm.hpp>
#include <optional>

namespace lod::patch {

struct TriangleHit {
  double distance = 0.0;    ///< in lengths of the ray's direction
  glm::dvec3 weights{0.0};  ///< weights of the corners; they sum to 1
};

class ShearedRay {
 public:
  /// `direction`: finite, not zero.
  ShearedRay(const glm::dvec3& origin, const glm::dvec3& direction) : origin_(origin) {
    const glm::dvec3 size = glm::abs(direction);
    z_ = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
    x_ = (z_ + 1) % 3;
    y_ = (x_ + 1) % 3;
    shear_ = {direction[x_] / direction[z_], direction[y_] / direction[z_], 1.0 / direction[z_]};
  }

  /// Either side is met, edges and corners belong to the triangle. A triangle that the ray runs along, or that has no
  /// area as the ray sees it, is not met. Distances may be negative.
  std::optional<TriangleHit> meets(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) const {
    const glm::dvec3 p = sheared(a);
    const glm::dvec3 q = sheared(b);
    const glm::dvec3 r = sheared(c);
    const double u = r.x * q.y - r.y * q.x;
    const double v = p.x * r.y - p.y * r.x;
    const double w = q.x * p.y - q.y * p.x;
    if ((u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0)) return std::nullopt;
    const double sum = u + v + w;
    if (!(std::abs(sum) > 0.0)) return std::nullopt;
    const glm::dvec3 weights(u / sum, v / sum, w / sum);
    return TriangleHit{weights.x * p.z + weights.y * q.z + weights.z * r.z, weights};
  }

 private:
  glm::dvec3 sheared(const glm::dvec3& corner) const {
    const glm::dvec3 from = corner - origin_;
    return {from[x_] - shear_.x * from[z_], from[y_] - shear_.y * from[z_], shear_.z * from[z_]};
  }

  glm::dvec3 origin_;
  glm::dvec3 shear_{0.0};
  int x_ = 0, y_ = 1, z_ = 2;
};

}  // namespace lod::patch
