#pragma once
// One node of the tree of bounding spheres in 32 bits, 48 with colour (Rusinkiewicz and Levoy 2000, section 3.1;
// docs/formats/qsplat.md). Decoding is inline: a traversal does it millions of times a frame.
//
// The tables have an entry for every bit pattern, so that an unchecked code reads nothing that is not there.
#include <array>
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>

#include "base/geometry.h"

namespace lod::qsplat {

// Spheres -----------------------------------------------------------------------------------------

/// Steps along the diameter of a parent: radii are 1 … 13 thirteenths of the parent's.
inline constexpr int kSphereSteps = 13;

/// Whether (s, x, y, z), 1 <= s <= 13, 0 <= x, y, z <= 13 - s, is a sphere that a child may have: the sphere around
/// its bounding cube reaches the parent's, |centre| <= 1 + sqrt(3) s/13. In whole numbers, so that it is exact.
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
/// By code; what is no code stands for the parent's own sphere. Made at the first call; keep the reference in loops.
const SphereTable& sphereTable();

/// The code of a sphere equal to its parent's: the last one.
inline constexpr std::uint32_t kWholeParent = kSphereCodes - 1;

/// What a code says, in thirteenths: the diameter of the sphere's bounding cube, and where on the parent's its least
/// corner is.
struct GridSphere {
  int s = kSphereSteps;       ///< 1 … 13
  std::array<int, 3> cell{};  ///< 0 … 13 − s
};
class SphereCodes {
 public:
  SphereCodes();
  /// code: below 2^13; what is no code stands for the parent's own sphere.
  const GridSphere& steps(std::uint32_t code) const { return steps_[code]; }
  /// kSphereCodes where there is no such sphere. s: 1 … 13; cell: each 0 … 12.
  std::uint32_t code(const GridSphere& of) const { return codes_[place(of)]; }

 private:
  static std::size_t place(const GridSphere& of) {
    return static_cast<std::size_t>(
        (((of.s - 1) * kSphereSteps + of.cell[0]) * kSphereSteps + of.cell[1]) * kSphereSteps + of.cell[2]);
  }
  std::array<GridSphere, std::size_t{1} << kSphereBits> steps_;
  std::array<std::uint16_t, kSphereSteps * kSphereSteps * kSphereSteps * kSphereSteps> codes_;
};
/// Made at the first call; keep the reference in loops.
const SphereCodes& sphereCodes();

/// What every reader computes, in float32. Sources that call it are compiled with -ffp-contract=off.
inline base::Sphere decodeSphere(const base::Sphere& parent, const RelativeSphere& step) {
  return {parent.center + parent.radius * step.offset, parent.radius * step.ratio};
}

/// The code of least s whose decoded sphere encloses `child`, the nearest of these. `parent` is a decoded sphere that
/// encloses the child; where it does not, as far as double precision tells, the code is kWholeParent.
std::uint32_t encodeSphere(const base::Sphere& parent, const base::Sphere& child);

/// Whether `outer` holds `inner`, computed in double; rounding there is allowed for (1e-12 of the outer radius).
bool encloses(const base::Sphere& outer, const base::Sphere& inner);

// Normals -----------------------------------------------------------------------------------------

inline constexpr std::uint32_t kNormalSide = 52;
inline constexpr std::uint32_t kNormalCodes = 6 * kNormalSide * kNormalSide;
inline constexpr std::uint32_t kNormalBits = 14;
static_assert(kNormalCodes <= 1U << kNormalBits);

/// Where a cell of a face begins, 0 … 52 and between: as a tangent, −1 … 1.
double cellBorder(double cell);

using NormalTable = std::array<glm::vec3, std::size_t{1} << kNormalBits>;
/// Unit vectors by code; +z for what is no code. Made at the first call.
const NormalTable& normalTable();

/// The cell that holds the direction `n`, of any length but 0; zero and what is not finite are taken for +z.
std::uint32_t encodeNormal(const glm::vec3& n);

// Cones of normals --------------------------------------------------------------------------------
//
// Sines of half-angles are evenly spaced: what a code gives away is then the same wherever the cone lies, and least in
// all where nothing is known of the widths. (The paper's are 1/16, 4/16, 9/16: they suit smooth scans.) Two bits are
// few. But where all of a group are leaves, as its parent says, the three bits that tell of children tell nothing; with
// them nineteen leaves in twenty have a cone of five bits.

/// The last code of either kind is any direction: never culled.
inline constexpr std::uint32_t kConeCodes = 4;
inline constexpr std::uint32_t kAnyDirection = kConeCodes - 1;
inline constexpr std::uint32_t kLeafConeCodes = 32;
inline constexpr std::uint32_t kAnyLeafDirection = kLeafConeCodes - 1;

/// By the node's bits 27 … 31, the sine of its cone's half-angle; infinite for any direction.
using ConeSines = std::array<float, 32>;
/// Of nodes in groups with a pointer, or without one.
const ConeSines& coneSines(bool has_pointer);

/// The narrowest code whose half-angle is at least the one with this cosine: the least cosine between the node's
/// decoded normal and the normals below it. NaN: any direction.
std::uint32_t encodeCone(double least_cosine);
/// The same of a leaf among leaves.
std::uint32_t encodeLeafCone(double least_cosine);

// Colours -----------------------------------------------------------------------------------------

/// sRGB in 5, 6 and 5 bits; red at the top. The nearest value of each.
std::uint16_t encodeColor(const glm::u8vec3& color);
inline glm::u8vec3 decodeColor(std::uint16_t bits) {
  const std::uint32_t r = bits >> 11;
  const std::uint32_t g = bits >> 5 & 63U;
  const std::uint32_t b = bits & 31U;
  return {static_cast<std::uint8_t>(r << 3 | r >> 2), static_cast<std::uint8_t>(g << 2 | g >> 4),
          static_cast<std::uint8_t>(b << 3 | b >> 2)};
}

// The node ----------------------------------------------------------------------------------------

inline constexpr std::uint32_t kMaxChildren = 4;

/// What the bits from 27 on say depends on the node's group: where that has a pointer, they are cone and children;
/// where it has none, all of it are leaves, and they are a leaf's cone.
struct Node {
  std::uint32_t bits = 0;
  std::uint16_t color = 0;  ///< of no meaning in files without colours

  std::uint32_t sphereCode() const { return bits & ((1U << kSphereBits) - 1); }
  std::uint32_t normalCode() const { return bits >> kSphereBits & ((1U << kNormalBits) - 1); }
  /// The place of its cone among ConeSines.
  std::uint32_t coneField() const { return bits >> 27; }
  /// Sphere and normal are codes.
  bool hasCodes() const { return sphereCode() < kSphereCodes && normalCode() < kNormalCodes; }

  // Of nodes in groups with a pointer.
  std::uint32_t coneCode() const { return bits >> 27 & 3U; }
  bool isLeaf() const { return (bits >> 29 & 3U) == 0; }
  /// 0, 2, 3 or 4.
  std::uint32_t children() const {
    const std::uint32_t field = bits >> 29 & 3U;
    return field == 0 ? 0 : field + 1;
  }
  bool childrenAreLeaves() const { return bits >> 31 != 0; }
  /// … and a leaf says nothing of children.
  bool valid() const { return hasCodes() && !(isLeaf() && childrenAreLeaves()); }
};

/// Of a group with a pointer. `children`: 0, 2, 3 or 4.
constexpr std::uint32_t packNode(std::uint32_t sphere, std::uint32_t normal, std::uint32_t cone, std::uint32_t children,
                                 bool children_are_leaves) {
  return sphere | normal << kSphereBits | cone << 27 | (children == 0 ? 0 : children - 1) << 29 |
         (children_are_leaves ? 1U << 31 : 0U);
}
/// A leaf among leaves.
constexpr std::uint32_t packLeaf(std::uint32_t sphere, std::uint32_t normal, std::uint32_t cone) {
  return sphere | normal << kSphereBits | cone << 27;
}

}  // namespace lod::qsplat
