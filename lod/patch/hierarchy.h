#pragma once
// The patch hierarchy in memory: a directed acyclic graph of groups and patches (Okamoto 2011, section 4.1, with groups
// in place of its binary tree). A server has all of it, a client's grows.
//
// Terms. A *group* was made by merging a few patches (those it *consumes*, its children), simplifying them with the
// outer boundary locked, and splitting the result into new patches (those it *produces*). Every patch but the roots is
// consumed by exactly one group; every patch but the leaves is produced by exactly one. To *expand* a group is to draw
// the patches it consumes instead of those it produces. Group 0 is virtual: it produces nothing, consumes the root
// patch, has infinite error and is always expanded. Groups are numbered top down: every parent of a group has a smaller
// number.
//
// Parents of group g: the groups that consume at least one of the patches g produced. Errors and spheres are monotone:
// a parent's error is at least its child's and a parent's sphere contains the child's, so projected errors are monotone
// too and the rule "expand g when its projected error exceeds the tolerance" never expands g without its parents. Every
// such cut is watertight.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error_measure.h"
#include "base/geometry.h"
#include "lod/lattice.h"

namespace lod::patch {

inline constexpr std::uint32_t kNoGroup = std::numeric_limits<std::uint32_t>::max();

struct Group {
  base::Sphere bounds;  ///< contains all geometry below and the spheres of the child groups
  float error = 0.0F;   ///< scene units; the distance in both directions between its products and the leaf geometry
                        ///< below is at most this; infinite for group 0
  float attribute_error =
      0.0F;  ///< the colours at both ends of these distances differ by at most this, 0 … 1 (1: black to white)
  float typical_error = 0.0F;        ///< scene units; the root mean square of the distance, an estimate
  float typical_color_error = 0.0F;  ///< the root mean square of the difference of colours, 0 … 1, an estimate
  float visible_error = 0.0F;  ///< scene units; what cuts go by unless they keep to the bound: twice the typical error,
                               ///< colours included; infinite for group 0
  std::uint32_t level = 0;     ///< level of the patches that it produces, ≥ 1
  std::uint32_t first_patch = 0;  ///< consumed patches: first_patch … first_patch + patch_count − 1
  std::uint32_t patch_count = 0;
  std::uint32_t first_parent = 0;  ///< into Hierarchy::parents
  std::uint32_t parent_count = 0;  ///< 0 only for group 0
  std::uint64_t block_offset = 0;  ///< where the bytes of its consumed patches lie in the file
  std::uint32_t block_bytes = 0;
};

struct Patch {
  base::Aabb box;
  base::Sphere bounds;
  base::NormalCone cone;
  std::uint32_t producer = kNoGroup;  ///< kNoGroup: a leaf (error 0: the source itself, quantised)
  std::uint32_t consumer = 0;
  std::uint16_t level = 0;         ///< 0 = leaf
  std::uint16_t color_detail = 0;  ///< of a leaf whose source has a texture: colorDetailOf() in 65535ths
  std::uint32_t triangles = 0;
  std::uint32_t vertices = 0;
  std::uint32_t block_offset = 0;  ///< within its consumer's block
  std::uint32_t block_bytes = 0;
  float own_error = 0.0F;  ///< its producer's error (0 for a leaf); travels with the patch, because a client may not
                           ///< have its producer yet
  float own_typical_error = 0.0F;  ///< the same of its producer's typical error
  float own_visible_error = 0.0F;  ///< the same of its producer's visible error
};

/// Errors are told to seven significant bits: built so, they are the same in tables and in the records that clients of
/// static hosts read (group_records.h). A float keeps all but so many of its bits.
inline constexpr unsigned kErrorShift = 17;
/// The least such error that is at least `error`, which is 0 or more.
inline float errorRoundedUp(float error) {
  const std::uint32_t bits = base::bitCast<std::uint32_t>(error) + (1U << kErrorShift) - 1;
  return base::bitCast<float>(bits >> kErrorShift << kErrorShift);
}
/// The nearest one, for estimates.
inline float errorRounded(float error) {
  const std::uint32_t bits = base::bitCast<std::uint32_t>(error) + (1U << (kErrorShift - 1));
  return base::bitCast<float>(bits >> kErrorShift << kErrorShift);
}

/// Nineteen of twenty points are within so many root mean squares.
inline constexpr float kVisibleRatio = 2.0F;

/// The error that decides whether a cut draws through the group, scene units. All measures are monotone.
inline float errorOf(const Group& group, base::ErrorMeasure measure) {
  if (measure == base::ErrorMeasure::kBound) return group.error;
  return measure == base::ErrorMeasure::kShape ? kVisibleRatio * group.typical_error : group.visible_error;
}
/// The same of the group that produced a patch, as it came with the patch.
inline float ownErrorOf(const Patch& patch, base::ErrorMeasure measure) {
  if (measure == base::ErrorMeasure::kBound) return patch.own_error;
  return measure == base::ErrorMeasure::kShape ? kVisibleRatio * patch.own_typical_error : patch.own_visible_error;
}

/// The root mean square difference, 0 … 1, of a leaf's texture from the colours of its vertices between them; 0 where
/// the source has no texture.
inline float colorDetailOf(const Patch& patch) {
  return static_cast<float>(patch.color_detail) / 65535.0F;
}

/// A difference of colour counts as a distance, in proportion to the edges over which colours are interpolated: one
/// from black to white as so many edges (docs/decisions/visible-error.md).
inline constexpr float kDetailLength = 2.0F;

/// The typical difference between a patch's colours and the source's, 0 … 1, as far as its own errors tell: the visible
/// error contains it. `mean_edge`: of the patch, scene units, above 0. For leaves it is their colorDetailOf().
inline float typicalColorErrorOf(const Patch& patch, float mean_edge) {
  if (patch.producer == kNoGroup) return colorDetailOf(patch);
  const float seen = patch.own_visible_error / kVisibleRatio;
  const float detail = std::sqrt(std::max(0.0F, seen * seen - patch.own_typical_error * patch.own_typical_error));
  return std::min(1.0F, detail / (kDetailLength * mean_edge));
}

struct Hierarchy {
  Lattice lattice;
  bool has_colors = false;
  std::uint64_t source_triangles = 0;
  std::vector<Group> groups;
  std::vector<Patch> patches;
  std::vector<std::uint32_t> parents;  ///< flattened; Group::first_parent and parent_count say where
  std::vector<std::uint8_t>
      known;  ///< per group, on a growing hierarchy: its record and patches are here. Empty: all are.

  bool isKnown(std::uint32_t group) const { return known.empty() || (group < known.size() && known[group] != 0); }
  std::span<const std::uint32_t> parentsOf(std::uint32_t group) const {
    return std::span(parents).subspan(groups[group].first_parent, groups[group].parent_count);
  }
};

/// Whether some leaf's source has a texture that its vertices' colours lack.
inline bool hasTextures(const Hierarchy& hierarchy) {
  return std::any_of(hierarchy.patches.begin(), hierarchy.patches.end(),
                     [](const Patch& patch) { return patch.color_detail != 0; });
}

/// One patch's geometry, decoded.
struct PatchGeometry {
  std::vector<glm::ivec3> positions;   ///< lattice points
  std::vector<glm::vec3> normals;      ///< unit (octahedral, 8 + 8 bits stored), as many as positions
  std::vector<glm::u8vec4> colors;     ///< RGB, a = 255; empty when the scene has none
  std::vector<std::uint16_t> indices;  ///< 3 per triangle, counter-clockwise from outside
};

}  // namespace lod::patch
