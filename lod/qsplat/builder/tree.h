#pragma once
// Builds a tree over splats (Rusinkiewicz and Levoy 2000, section 2.2, BuildTree): sets are split along the longest
// axis, and from the bottom up each node gets a bounding sphere around its children.
//
// A tile of leaves becomes a Subtree, whose nodes wait on disk. The top tree over all tiles is built in the same way,
// with the tiles' roots as leaves. Spheres are absolute here; encodeSubtree() encodes them relative to their parents.
#include <array>
#include <functional>
#include <vector>

#include "base/bytes.h"
#include "lod/qsplat/builder/splat.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

/// Which widths the cones of leaves may have in groups of leaves: each code, or every fourth. With each the coded form
/// is 4 % longer (docs/results/qsplat.md), the plain one no longer.
enum class LeafCones : std::uint8_t { kEach, kEveryFourth };

/// A node as it lies on disk between building and encoding.
struct TreeNode {
  base::Sphere sphere;
  std::uint32_t bits = 0;  ///< packNode with sphere code 0
  std::uint16_t color = 0;
  std::uint16_t leaf_cone = 0;  ///< a leaf's code in a group of leaves

  /// The node of the file, for a group with a pointer or without.
  Node encoded(std::uint32_t sphere_code, bool has_pointer, LeafCones leaf_cones) const {
    const Node node{bits | sphere_code, color};
    if (has_pointer) return node;
    const std::uint32_t cone = leaf_cones == LeafCones::kEach ? leaf_cone : leaf_cone | 3U;
    return {packLeaf(sphere_code, node.normalCode(), cone), color};
  }
};
static_assert(sizeof(TreeNode) == 24);

/// The cosine of the half-angle of a node's cone, as it is coded; -1 for any direction.
float cosineOfCone(const TreeNode& node);

TreeNode nodeFor(const Splat& splat, std::uint32_t children, bool children_are_leaves);

/// A tree over given splats, by number.
struct TreeShape {
  static constexpr std::uint32_t kLeaf = 1U << 31;
  struct InnerNode {
    Splat splat;
    std::uint32_t count = 0;  ///< children: 2, 3 or 4
    /// The number of an inner node, or kLeaf + the number of a given splat.
    std::array<std::uint32_t, kMaxChildren> children{};
  };
  std::vector<InnerNode> inner;
  std::uint32_t root = 0;  ///< like a child
};

/// Builds a tree over 1 to 2^31 − 1 splats. A set is split at the middle of its box's longest side, or in halves by
/// count where that would leave less than a sixteenth on one side, so that no tree is deep (section 3.2 says why not
/// always). An inner node's normal is the mean of those below, or up to 0.07 rad from it where its cone then has a
/// narrower code. `facets` are around the splats; without them cones are computed from the splats' cones.
TreeShape makeTree(std::span<const Splat> splats, const LeafFacets& facets = {});

/// A tile's nodes, breadth first.
struct Subtree {
  Splat root;
  std::vector<TreeNode> nodes;             ///< the root first
  std::vector<std::uint32_t> level_nodes;  ///< how many nodes each level has
  std::uint64_t added_leaves = 0;          ///< leaves that are not a vertex or point of the source
};
Subtree makeSubtree(std::span<const Splat> leaves, const LeafFacets& facets = {});

/// The encoded groups of one level, until they are written. A group is a byte with its number of nodes, and bit 7 set
/// where it has a pointer, and then its nodes of 4 bytes, or of 6 with colours.
using Run = base::Bytes;
void appendGroup(Run& run, const GroupNodes& group, bool colors);
/// Reads the group that begins at `at`, and advances `at` behind it. A group without nodes marks the end, or damage.
GroupNodes readGroup(base::ByteView run, std::size_t& at, bool colors);

/// Gets a leaf's number, its coded sphere's radius and its parent's decoded sphere.
using VisitLeaf = std::function<void(std::uint32_t leaf, float radius, const base::Sphere& parent)>;
/// Encodes a tile's tree from the top down: each sphere relative to its parent's decoded one (section 3.1), and the
/// groups of each level one after the other. Returns a run for each level below the root; run 0 holds the root's
/// children. `root` is the root's decoded sphere. `visit_leaf` is called for each leaf below the root; it may be empty.
std::vector<Run> encodeSubtree(std::span<const TreeNode> nodes, const base::Sphere& root, bool colors,
                               LeafCones leaf_cones, const VisitLeaf& visit_leaf = {});

}  // namespace lod::qsplat::builder
