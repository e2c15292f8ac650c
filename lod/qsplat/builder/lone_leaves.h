#pragma once
// Keeps leaves far from all others small. A sphere is coded as at least a thirteenth of the one above it, and a node
// that holds a bird above a survey and a part of the ground reaches from one to the other: the bird would be drawn as a
// ball a sixth as large as its height, or, at a pole of that node's sphere, as large as the node itself.
//
// So such a node is made a little wider, which keeps the leaf from its poles, and the leaf is repeated below nodes of
// its own, each a sixth to a thirteenth as large as the one above. A node has two children at least, so that k of them
// one above the other hold the leaf 2^k times.
#include <cstdint>
#include <span>
#include <vector>

#include "lod/qsplat/builder/tree.h"

namespace lod::qsplat::builder {

/// The median radius of the leaves among the nodes, scene units; 0 where there are none.
float usualRadius(std::span<const TreeNode> nodes);

/// Widens the nodes, given breadth first, that are far larger than one of their children and than usual leaves, and
/// those above them. Returns whether there were any. Each node encloses its children as before.
bool widenAroundLone(std::span<TreeNode> nodes);

/// A leaf whose coded sphere is much larger than its own and than usual.
struct LargeLeaf {
  std::uint32_t node = 0;  ///< its number
  base::Sphere parent;     ///< as it is decoded
  float radius = 0.0F;     ///< of the coded sphere, scene units
};
/// Whether a leaf's coded sphere is much larger than its own and than usual, scene units.
bool isTooLarge(float coded, float own, float usual);

struct NestedLeaves {
  std::vector<TreeNode> nodes;     ///< breadth first
  std::uint64_t added_leaves = 0;  ///< how many of the leaves repeat another
};
/// Repeats leaves of a tile's tree of two nodes or more below nodes of their own, until their coded spheres are no
/// longer too large. The largest come first; the tree gets at most a sixteenth more leaves, or 1024 where that is more.
NestedLeaves nestLargeLeaves(std::vector<TreeNode> nodes, std::vector<LargeLeaf> large, float usual);

}  // namespace lod::qsplat::builder
