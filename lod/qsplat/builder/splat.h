#pragma once
// A node of the tree while it is built (Rusinkiewicz and Levoy 2000, section 2.2): a leaf, or the sum of the leaves
// below an inner node.
#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/geometry.h"
#include "lod/qsplat/node.h"

namespace lod::qsplat::builder {

struct Splat {
  base::Sphere sphere;
  glm::vec3 normal{0.0F};       ///< sum over the leaves below of unit normals times weights
  glm::vec3 color{0.0F};        ///< sum over the leaves below of colours (0 … 255) times weights
  float weight = 0.0F;          ///< > 0, sum over the leaves below; a leaf of a surface weighs its share of the area
  std::uint32_t direction = 0;  ///< the code of the normal
  float least_cosine = -1.0F;   ///< between the decoded normal and the surface's normals below; -1 where unknown

  glm::u8vec3 meanColor() const { return glm::u8vec3(glm::clamp(color / weight + 0.5F, 0.0F, 255.0F)); }
};

/// A sphere around 2 to 4 spheres, at most a hundredth wider than the smallest one. encloses() holds for
/// each of them.
base::Sphere enclosingSphere(std::span<const base::Sphere> spheres);

/// Whether a node reaches across gaps between its leaves: its radius is more than 3 times that of a disc as large as
/// the discs of all its leaves. Round pieces of surfaces have 1 to 1.7 times. `leaf_squares`: sum of the leaves'
/// squared radii.
inline bool isSpread(float radius, double leaf_squares) {
  return static_cast<double>(radius) > 3.0 * std::sqrt(leaf_squares);
}

/// The parent of 2 to 4 children, without its cone.
Splat parentOf(std::span<const Splat* const> children);

/// The normals of those facets around leaves that lie outside a narrow cone around the leaf's decoded normal. They tell
/// which part of the leaf's whole cone is empty. Leaves from points have none.
struct LeafFacets {
  /// Cosine and sine of the narrow cone's half-angle, 0.1 rad. Few facets of a smooth surface lie outside.
  static constexpr float kCoreCosine = 0.9950042F;
  static constexpr float kCoreSine = 0.0998334F;
  std::vector<std::uint32_t> first;  ///< by leaf, and the end: its first normal; empty where no leaf has any
  std::vector<glm::vec3> normals;    ///< unit

  bool empty() const { return normals.empty(); }
};

struct TileLeaves {
  std::vector<Splat> splats;  ///< in an order that depends on the source only; may be empty
  LeafFacets facets;          ///< around them
  std::uint64_t added = 0;    ///< how many splats are not a vertex or point of the source
};

/// The interface from which the tree is built: leaves, tile by tile, of a mesh or of points.
class LeafSource {
 public:
  virtual ~LeafSource() = default;
  virtual std::size_t tiles() const = 0;
  /// The most bytes that leaves() and then a tree over them take.
  virtual std::uint64_t memoryOf(std::size_t tile) const = 0;
  /// Safe from several threads. Errors: those of reading.
  virtual base::Result<TileLeaves> leaves(std::size_t tile) const = 0;
};

/// About the rounding error of a cosine between two normals in float32. For small angles it is a large part of the
/// angle.
inline constexpr float kCosineRounding = 3e-7F;
/// The sine of an angle known by its cosine, rounded up.
inline float sineOf(float cosine) {
  return std::sqrt(std::max(0.0F, 1.0F - cosine * cosine) + 2.0F * kCosineRounding);
}
/// The cosine of the sum of two angles, rounded down. The first is given by its cosine, the second by cosine and sine.
/// -1 where either angle or the sum is above a right angle.
inline float cosineOfSum(float cosine_a, float cosine_b, float sine_b) {
  if (cosine_a <= 0.0F || cosine_b <= 0.0F) return -1.0F;
  return cosine_a * cosine_b - sineOf(cosine_a) * sine_b;
}

}  // namespace lod::qsplat::builder
