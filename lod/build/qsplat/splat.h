#pragma once
// What a node of the tree stands for while it is built (Rusinkiewicz and Levoy 2000, section 2.2): a leaf, or all that
// lies below an inner node. Private to lod/build/qsplat.
#include <span>

#include "base/geometry.h"
#include "lod/qsplat/node.h"

namespace lod::build::qsplat {

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

/// The least cosine between the direction `axis` and the normals in a leaf's cone; -1 beyond a right angle.
float leastCosine(const glm::vec3& axis, const Splat& leaf);

}  // namespace lod::build::qsplat
