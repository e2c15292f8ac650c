#pragma once
// What a node of the tree stands for while it is built (Rusinkiewicz and Levoy 2000, section 2.2): a leaf, or all that
// lies below an inner node. Private to lod/build/qsplat.
#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "base/geometry.h"
#include "lod/qsplat/node.h"

namespace lod::qsplat::builder {

struct Splat {
  base::Sphere sphere;
  glm::vec3 normal{0.0F};       ///< sum over the leaves below: unit normals by weight
  glm::vec3 color{0.0F};        ///< the same of colours, 0 … 255 each
  float weight = 0.0F;          ///< sum over the leaves below; above 0. A surface's leaf: its share of the area
  std::uint32_t direction = 0;  ///< the normal as a code
  float least_cosine = -1.0F;   ///< between the decoded normal and those of the surface below; -1: nothing is known

  glm::u8vec3 meanColor() const { return glm::u8vec3(glm::clamp(color / weight + 0.5F, 0.0F, 255.0F)); }
};

/// The smallest sphere around 2 to 4 spheres, or up to a hundredth wider; holds them as lod::qsplat::encloses tells.
base::Sphere enclosingSphere(std::span<const base::Sphere> spheres);

/// What 2 to 4 children make together, but for its cone.
Splat parentOf(std::span<const Splat* const> children);

/// Normals of facets around leaves, of each those that lie outside a narrow cone around its decoded normal: of the cone
/// that holds them all, they tell which part is empty. Leaves from points have none.
struct LeafFacets {
  /// Cosine and sine of the narrow cone's half-angle, 0.1 rad: few facets of a smooth surface lie outside.
  static constexpr float kCoreCosine = 0.9950042F;
  static constexpr float kCoreSine = 0.0998334F;
  std::vector<std::uint32_t> first;  ///< by leaf, and the end: its first one among the normals; empty: none has any
  std::vector<glm::vec3> normals;    ///< unit

  bool empty() const { return normals.empty(); }
};

/// What cosines of angles between two normals in float32 are off by, about. Near 0 that is much of an angle.
inline constexpr float kCosineRounding = 3e-7F;
/// Sine of an angle known by its cosine: not less than it is.
inline float sineOf(float cosine) {
  return std::sqrt(std::max(0.0F, 1.0F - cosine * cosine) + 2.0F * kCosineRounding);
}
/// Cosine of the sum of two angles, given by cosine and by cosine and sine, not more than it is; -1 where one of them,
/// or the sum, is above a right angle.
inline float cosineOfSum(float cosine_a, float cosine_b, float sine_b) {
  if (cosine_a <= 0.0F || cosine_b <= 0.0F) return -1.0F;
  return cosine_a * cosine_b - sineOf(cosine_a) * sine_b;
}

}  // namespace lod::qsplat::builder
