#pragma once
// Intersects a ray with a triangle without gaps between triangles: Woop, Benthin and Wald 2013, "Watertight
// Ray/Triangle Intersection", in double throughout. The corners are sheared so that the ray becomes the z axis, and
// three edge functions tell on which side of each edge it passes. Two triangles compute the function of an edge that
// they share from the same numbers, so a ray cannot slip through between them. That holds only as long as products are
// not fused with sums: files that include this are built with -ffp-contract=off. Private to lod/patch.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>

#include "base/simd.h"

namespace lod::patch {

struct TriangleHit {
  double distance = 0.0;    ///< in lengths of the ray's direction
  glm::dvec3 weights{0.0};  ///< weights of the corners; they sum to 1
};

class ShearedRay {
 public:
  /// `direction`: finite, not zero.
  ShearedRay(const glm::dvec3& origin, const glm::dvec3& direction) : origin_(origin), start_(origin) {
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

  /// Four triangles by corner and axis.
  using FourTriangles = base::Float4[3][3];
  /// Tells quickly which of four triangles the ray may pass between the edges of: bit i is 0 only where meets() returns
  /// nothing for triangle i. The arithmetic is that of meets() in float, with bounds of its rounding.
  LUMIGRID_ALWAYS_INLINE std::uint32_t mayMeet(const FourTriangles& corners) const {
    using base::Float4;
    const auto four = [](float value) { return Float4{value, value, value, value}; };
    const auto largest = [](Float4 a, Float4 b) { return a > b ? a : b; };
    const auto size = [](Float4 a) { return a < Float4{} ? -a : a; };
    const Float4 origin[3] = {four(start_.x), four(start_.y), four(start_.z)};
    const Float4 shear_x = four(static_cast<float>(shear_.x)), shear_y = four(static_cast<float>(shear_.y));
    Float4 x[3], y[3];
    Float4 far_x{}, far_y{}, terms_x{}, terms_y{};  // the largest results, and the terms that they are made of
    for (int corner = 0; corner < 3; ++corner) {
      const Float4 from_x = corners[corner][x_] - origin[x_];
      const Float4 from_y = corners[corner][y_] - origin[y_];
      const Float4 from_z = corners[corner][z_] - origin[z_];
      x[corner] = from_x - shear_x * from_z;
      y[corner] = from_y - shear_y * from_z;
      far_x = largest(far_x, size(x[corner])), far_y = largest(far_y, size(y[corner]));
      terms_x = largest(terms_x, size(from_x) + size(from_z));  // |shear| ≤ 1
      terms_y = largest(terms_y, size(from_y) + size(from_z));
    }
    const Float4 u = x[2] * y[1] - y[2] * x[1];
    const Float4 v = x[0] * y[2] - y[0] * x[2];
    const Float4 w = x[1] * y[0] - y[1] * x[0];
    // A coordinate errs by at most 5 roundings of its terms, and the products and their difference by 3 of theirs.
    constexpr float kRounding = 6e-8F;
    const Float4 off = four(12.0F * kRounding) * (terms_x * far_y + terms_y * far_x + far_x * far_y) +
                       four(64.0F * kRounding * kRounding) * terms_x * terms_y;
    const auto is_below = (u < -off) | (v < -off) | (w < -off);
    const auto is_above = (u > off) | (v > off) | (w > off);
    return ~base::bitsOf(is_below & is_above) & 15U;
  }

 private:
  glm::dvec3 sheared(const glm::dvec3& corner) const {
    const glm::dvec3 from = corner - origin_;
    return {from[x_] - shear_.x * from[z_], from[y_] - shear_.y * from[z_], shear_.z * from[z_]};
  }

  glm::dvec3 origin_;
  glm::vec3 start_;
  glm::dvec3 shear_{0.0};
  int x_ = 0, y_ = 1, z_ = 2;
};

}  // namespace lod::patch
