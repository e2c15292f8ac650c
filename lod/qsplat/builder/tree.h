#pragma once
// Splats to a tree (Rusinkiewicz and Levoy 2000, section 2.2, BuildTree): split along the longest axis, bottom up a
// bounding sphere around each node's children. Private to lod/build/qsplat.
//
// A tile of leaves becomes a Subtree, whose nodes wait on disk; the tree over all tiles is one more, whose leaves are
// the tiles' roots. Spheres are true ones here: they are made relative to their parents from the top down (encode.h).
#include <array>
#include <vector>

#include "lod/qsplat/builder/splat.h"

namespace lod::qsplat::builder {

/// What is kept of the widths of leaves' cones among leaves: each, or every fourth. The coded form is 4 % longer with
/// each (docs/results/qsplat.md), the plain one as long.
enum class LeafCones : std::uint8_t { kEach, kEveryFourth };

/// As it lies on disk between building and encoding.
struct TreeNode {
  base::Sphere sphere;
  std::uint32_t bits = 0;  ///< lod::qsplat::packNode with sphere code 0
  std::uint16_t color = 0;
  std::uint16_t leaf_cone = 0;  ///< of a leaf, its code among leaves

  /// As it stands in the file, in a group with a pointer or without.
  lod::qsplat::Node encoded(std::uint32_t sphere_code, bool has_pointer, LeafCones leaf_cones) const {
    const lod::qsplat::Node node{bits | sphere_code, color};
    if (has_pointer) return node;
    const std::uint32_t cone = leaf_cones == LeafCones::kEach ? leaf_cone : leaf_cone | 3U;
    return {lod::qsplat::packLeaf(sphere_code, node.normalCode(), cone), color};
  }
};
static_assert(sizeof(TreeNode) == 24);

TreeNode nodeFor(const Splat& splat, std::uint32_t children, bool children_are_leaves);

/// A node over splats given by number.
struct TreeShape {
  static constexpr std::uint32_t kLeaf = 1U << 31;
  struct Inner {
    Splat splat;
    std::uint32_t count = 0;  ///< of children: 2, 3 or 4
    /// Inner nodes by number, or kLeaf + the number of a given splat.
    std::array<std::uint32_t, lod::qsplat::kMaxChildren> children{};
  };
  std::vector<Inner> inner;
  std::uint32_t root = 0;  ///< as among children
};

/// Over at least one splat, fewer than 2^31. A part is split at the middle of its box's longest side; in halves by
/// count where that would leave less than a sixteenth on one side, so that no tree is deep (section 3.2 says why not
/// always). An inner node's normal is the mean of those below, or up to 0.07 rad from it where its cone then has a
/// narrower code. `facets`: around the splats; none: their cones are all that is known.
TreeShape makeTree(std::span<const Splat> splats, const LeafFacets& facets = {});

/// A tile's nodes, breadth first.
struct Subtree {
  Splat root;
  std::vector<TreeNode> nodes;             ///< the root first
  std::vector<std::uint32_t> level_nodes;  ///< how many of them are of each level
  std::uint64_t added_leaves = 0;          ///< that are no vertex or point of the source
};
Subtree makeSubtree(std::span<const Splat> leaves, const LeafFacets& facets = {});

}  // namespace lod::qsplat::builder
