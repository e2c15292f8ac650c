#pragma once
// How far a place of a surface is from one of the same appearance on a triangle (Guthe et al. 2004, section 3.1).
//
// With q' the place of the triangle closest to p, and q the closest one with p's normal or colour, pq' and q'q are
// taken for orthogonal: ε² = ε_geo² + ε_app². ε_app is the difference of the attribute at q' divided by κ, how fast the
// attribute changes along the triangle: its steepest edge.
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>

namespace lod::hlod::builder {

/// The attributes that count, and how different they must be: smaller differences cannot be seen.
struct AppearanceOptions {
  bool normals = true;
  bool colors = true;
  float negligible_turn = 0.02F;  ///< radians between normals
  float negligible_color = 5.0F;  ///< 0 … 255 a channel, Euclidean: what storing colours may change
  bool isShapeAlone() const { return !normals && !colors; }
};

struct Attributes {
  glm::vec3 position{0.0F};
  glm::vec3 normal{0.0F, 0.0F, 1.0F};  ///< unit
  glm::vec3 color{0.0F};               ///< 0 … 255
};

/// The angle between unit vectors, radians. For small angles it is the length of their difference (section 3.1), which
/// is corrected here so that it holds for large ones, too.
inline float angleBetween(const glm::vec3& a, const glm::vec3& b) {
  return 2.0F * std::asin(std::fmin(0.5F * glm::length(a - b), 1.0F));
}

/// The weights of the corners at the place of the triangle closest to p (Ericson 2005, section 5.1.5).
inline glm::vec3 closestWeights(const glm::vec3& p, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  const glm::vec3 ab = b - a, ac = c - a, ap = p - a;
  const float d1 = glm::dot(ab, ap), d2 = glm::dot(ac, ap);
  if (d1 <= 0.0F && d2 <= 0.0F) return {1.0F, 0.0F, 0.0F};
  const glm::vec3 bp = p - b;
  const float d3 = glm::dot(ab, bp), d4 = glm::dot(ac, bp);
  if (d3 >= 0.0F && d4 <= d3) return {0.0F, 1.0F, 0.0F};
  const float vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0F && d1 >= 0.0F && d3 <= 0.0F) {
    const float share = d1 - d3 > 0.0F ? d1 / (d1 - d3) : 0.0F;
    return {1.0F - share, share, 0.0F};
  }
  const glm::vec3 cp = p - c;
  const float d5 = glm::dot(ab, cp), d6 = glm::dot(ac, cp);
  if (d6 >= 0.0F && d5 <= d6) return {0.0F, 0.0F, 1.0F};
  const float vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0F && d2 >= 0.0F && d6 <= 0.0F) {
    const float share = d2 - d6 > 0.0F ? d2 / (d2 - d6) : 0.0F;
    return {1.0F - share, 0.0F, share};
  }
  const float va = d3 * d6 - d5 * d4;
  if (va <= 0.0F && d4 - d3 >= 0.0F && d5 - d6 >= 0.0F) {
    const float sum = (d4 - d3) + (d5 - d6);
    const float share = sum > 0.0F ? (d4 - d3) / sum : 0.0F;
    return {0.0F, 1.0F - share, share};
  }
  const float scale = 1.0F / (va + vb + vc);
  return {va * scale, vb * scale, vc * scale};
}

/// A triangle with its curvatures.
class AppearanceTriangle {
 public:
  AppearanceTriangle() = default;
  AppearanceTriangle(const Attributes& a, const Attributes& b, const Attributes& c, const AppearanceOptions& options);

  /// ε² of the place, in units of the positions; infinite where the triangle has no such appearance. `enough2`: once
  /// the distance alone is more, that is returned.
  float error2(const Attributes& place, float enough2) const;

 private:
  std::array<Attributes, 3> corners_;
  AppearanceOptions options_;
  float turn_ = 0.0F;   // κ of normals, radians per unit
  float slope_ = 0.0F;  // κ of colours, per unit
};

}  // namespace lod::hlod::builder
