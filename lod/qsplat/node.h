#pragma once
// One node of the tree of bounding spheres in 32 bits, 48 with colour (Rusinkiewicz and Levoy 2000, section 3.1;
// docs/formats/qsplat.md). Decoding is inline: a traversal does it millions of times a frame.
//
// The tables have an entry for every bit pattern, so that an unchecked code never reads beyond them.
#include <array>
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>

#include "base/geometry.h"

namespace lod::qsplat {

// Spheres -----------------------------------------------------------------------------------------

/// Steps along the diameter of a parent: radii are 1 … 13 thirteenths of the parent's.
inline constexpr int kSphereSteps = 13;

/// Whether a child may have the sphere (s, x, y, z) with 1 <= s <= 13 and 0 <= x, y, z <= 13 - s: the sphere around its
/// bounding cube reaches the parent's, |centre| <= 1 + sqrt(3) s/13. Computed in whole numbers, so that it is exact.
constexpr bool isChildSphere(int s, int x, int y, int z) {
  const auto square = [](long long v) { return v * v; };
  const long long beyond = square(s + 2 * x - kSphereSteps) + square(s + 2 * y - kSphereSteps) +
                           square(s + 2 * z - kSphereSteps) - square(kSphereSteps) - 3 * square(s);
  return beyond <= 0 || square(beyond) <= 12 * square(kSphereSteps) * square(s);
}

constexpr std::uint32_t countSphereCodes() {
  std::uint32_t count = 0;
  for (int s = 1; s <= kSphereSteps; ++s)
    for (int x = 0; x <= kSphereSteps - s; ++x)
      for (int y = 0; y <= kSphereSteps - s; ++y)
        for (int z = 0; z <= kSphereSteps - s; ++z) count += isChildSphere(s, x, y, z) ? 1 : 0;
  return count;
}
inline constexpr std::uint32_t kSphereCodes = countSphereCodes();
inline constexpr std::uint32_t kSphereBits = 13;
static_assert(kSphereCodes <= 1U << kSphereBits);

/// A child's sphere in units of its parent's radius, from the parent's centre.
struct RelativeSphere {
  glm::vec3 offset{0.0F};
  float ratio = 1.0F;
};
using SphereTable = std::array<RelativeSphere, std::size_t{1} << kSphereBits>;
/// Returns the relative spheres by code; a number that is no code stands for the parent's own sphere. The table is
/// built at the first call; keep the reference in loops.
const SphereTable& sphereTable();

/// The code of a sphere equal to its parent's: the last one.
inline constexpr std::uint32_t kWholeParent = kSphereCodes - 1;

/// A code's sphere on the grid of thirteenths of the parent's bounding cube: the diameter of its own bounding cube, and
/// the position of that cube's lowest corner.
struct GridSphere {
  int s = kSphereSteps;       ///< diameter, 1 … 13
  std::array<int, 3> cell{};  ///< corner, each 0 … 13 − s
};
class SphereCodes {
 public:
  SphereCodes();
  /// `code`: below 2^13; a number that is no code stands for the parent's own sphere.
  const GridSphere& sphere(std::uint32_t code) const { return spheres_[code]; }
  /// Returns kSphereCodes where there is no such sphere. s: 1 … 13; cell: each 0 … 12.
  std::uint32_t code(const GridSphere& sphere) const { return codes_[index(sphere)]; }

 private:
  static std::size_t index(const GridSphere& sphere) {
    return static_cast<std::size_t>((((sphere.s - 1) * kSphereSteps + sphere.cell[0]) * kSphereSteps + sphere.cell[1]) *
                                        kSphereSteps +
                                    sphere.cell[2]);
  }
  std::array<GridSphere, std::size_t{1} << kSphereBits> spheres_;
  std::array<std::uint16_t, kSphereSteps * kSphereSteps * kSphereSteps * kSphereSteps> codes_;
};
/// Built at the first call; keep the reference in loops.
const SphereCodes& sphereCodes();

/// Decodes a child's sphere in float32, to the same bits in every reader: sources that call this are compiled with
/// -ffp-contract=off, since products must be rounded before they are added.
inline base::Sphere decodeSphere(const base::Sphere& parent, const RelativeSphere& relative) {
  return {parent.center + parent.radius * relative.offset, parent.radius * relative.ratio};
}

/// Returns the code of least s whose decoded sphere encloses `child`; of several, the one with the nearest centre.
/// `parent` is a decoded sphere that encloses the child; where it does not in double precision, the code is
/// kWholeParent.
std::uint32_t encodeSphere(const base::Sphere& parent, const base::Sphere& child);

/// Whether `outer` encloses `inner`, computed in double with a tolerance of 1e-12 of the outer radius for its rounding.
bool encloses(const base::Sphere& outer, const base::Sphere& inner);

// Normals -----------------------------------------------------------------------------------------

inline constexpr std::uint32_t kNormalSide = 52;
inline constexpr std::uint32_t kNormalCodes = 6 * kNormalSide * kNormalSide;
inline constexpr std::uint32_t kNormalBits = 14;
static_assert(kNormalCodes <= 1U << kNormalBits);

/// Returns where a cell of a cube face begins, as a tangent of −1 … 1; `cell`: 0 … 52, fractions allowed.
double cellBorder(double cell);

using NormalTable = std::array<glm::vec3, std::size_t{1} << kNormalBits>;
/// Returns the unit vectors by code; +z for a number that is no code. The table is built at the first call.
const NormalTable& normalTable();

/// Returns the code of the cell that contains the direction `n`, of any length. Zero and vectors that are not finite
/// are encoded as +z.
std::uint32_t encodeNormal(const glm::vec3& n);

// Cones of normals --------------------------------------------------------------------------------
//
// Sines of half-angles are evenly spaced: rounding up then costs the same wherever the true width lies, and least on
// average where nothing is known about widths. (The paper's 1/16, 4/16, 9/16 suit smooth scans.) Two bits are few. But
// in a group whose parent says that all its nodes are leaves, the three bits about children are free; with them
// nineteen leaves in twenty have a cone of five bits (docs/results/qsplat.md).

/// The last code of either kind means any direction: such nodes are never culled.
inline constexpr std::uint32_t kConeCodes = 4;
inline constexpr std::uint32_t kAnyDirection = kConeCodes - 1;
inline constexpr std::uint32_t kLeafConeCodes = 32;

/// The sine of a cone's half-angle, by the node's bits 27 … 31; infinite for any direction.
using ConeSines = std::array<float, 32>;
/// Returns the sines for nodes in groups with or without a pointer.
const ConeSines& coneSines(bool has_pointer);

/// Returns the narrowest code whose half-angle has at most this cosine. `least_cosine`: the smallest one between the
/// node's decoded normal and the normals below the node; NaN: any direction.
std::uint32_t encodeCone(double least_cosine);
/// The same for a leaf in a group of leaves.
std::uint32_t encodeLeafCone(double least_cosine);

// Colours -----------------------------------------------------------------------------------------

/// Rounds each channel of an sRGB colour to 5, 6 and 5 bits; red is at the top.
std::uint16_t encodeColor(const glm::u8vec3& color);

// The node ----------------------------------------------------------------------------------------

inline constexpr std::uint32_t kMaxChildren = 4;

/// The meaning of bits 27 … 31 depends on the node's group: with a pointer they are the cone and the children; without
/// one all nodes of the group are leaves, and they are a leaf's cone.
struct Node {
  std::uint32_t bits = 0;
  std::uint16_t color = 0;  ///< unused in files without colours

  std::uint32_t sphereCode() const { return bits & ((1U << kSphereBits) - 1); }
  std::uint32_t normalCode() const { return bits >> kSphereBits & ((1U << kNormalBits) - 1); }
  /// Index into ConeSines.
  std::uint32_t coneField() const { return bits >> 27; }
  /// Whether sphere and normal are codes.
  bool hasCodes() const { return sphereCode() < kSphereCodes && normalCode() < kNormalCodes; }

  // The following hold for nodes in groups with a pointer.
  std::uint32_t coneCode() const { return bits >> 27 & 3U; }
  bool isLeaf() const { return (bits >> 29 & 3U) == 0; }
  /// Returns the number of children: 0, 2, 3 or 4.
  std::uint32_t children() const {
    const std::uint32_t field = bits >> 29 & 3U;
    return field == 0 ? 0 : field + 1;
  }
  bool childrenAreLeaves() const { return bits >> 31 != 0; }
  /// Whether all codes are valid, and a leaf claims nothing about children.
  bool valid() const { return hasCodes() && !(isLeaf() && childrenAreLeaves()); }
};

/// Packs a node of a group with a pointer. `children`: 0, 2, 3 or 4.
constexpr std::uint32_t packNode(std::uint32_t sphere, std::uint32_t normal, std::uint32_t cone, std::uint32_t children,
                                 bool children_are_leaves) {
  return sphere | normal << kSphereBits | cone << 27 | (children == 0 ? 0 : children - 1) << 29 |
         (children_are_leaves ? 1U << 31 : 0U);
}
/// Packs a leaf of a group without a pointer.
constexpr std::uint32_t packLeaf(std::uint32_t sphere, std::uint32_t normal, std::uint32_t cone) {
  return sphere | normal << kSphereBits | cone << 27;
}

}  // namespace lod::qsplat
