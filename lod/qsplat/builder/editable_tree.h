#pragma once
// A tile's tree while strays are moved in and out (strays.h).
#include <cstdint>
#include <limits>
#include <span>
#include <unordered_map>
#include <vector>

#include "lod/qsplat/builder/tree.h"

namespace lod::qsplat::builder {

/// Nodes are numbered as in the row that the tree was made from; added ones follow. Numbers stay when others go. Making
/// it of a row is one pass, and edits are kept apart, since they are few.
class EditableTree {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  struct Children {
    std::uint32_t count = 0;
    std::array<std::uint32_t, kMaxChildren> numbers{};
    std::span<const std::uint32_t> view() const { return std::span(numbers).first(count); }
  };

  /// `nodes`: breadth first, as in Subtree; none make an empty tree.
  explicit EditableTree(std::vector<TreeNode> nodes);

  bool empty() const { return root_ == kNone; }
  std::uint32_t root() const { return root_; }
  const TreeNode& node(std::uint32_t number) const { return nodes_[number]; }
  /// kNone for the root.
  std::uint32_t parent(std::uint32_t number) const;
  Children children(std::uint32_t number) const {
    if (is_edited_[number]) return edited_.at(number);
    Children out;
    out.count = Node{nodes_[number].bits, 0}.children();
    for (std::uint32_t c = 0; c < out.count; ++c) out.numbers[c] = first_child_[number] + c;
    return out;
  }
  bool isLeaf(std::uint32_t number) const { return Node{nodes_[number].bits, 0}.isLeaf(); }
  /// Returns the numbers of a node and of all below it, breadth first.
  std::vector<std::uint32_t> order(std::uint32_t from) const;
  /// Returns these nodes; what they say about their children is up to date.
  std::vector<TreeNode> nodesFrom(std::uint32_t number) const;

  /// Removes a node with all below it. A parent that is left with one child gives its place to that child.
  void remove(std::uint32_t number);
  /// Adds a tree, given as its nodes breadth first, below an inner node: as one more child, or together with the child
  /// that it is nearest to. Spheres and cones above it grow where they must.
  void add(std::uint32_t parent, std::span<const TreeNode> nodes);
  /// Puts a tree, given as its nodes breadth first, in the place of a leaf other than the root. Nothing above changes:
  /// it must lie within the parent's sphere.
  void replaceLeaf(std::uint32_t leaf, std::span<const TreeNode> nodes);

 private:
  std::uint32_t append(std::span<const TreeNode> nodes);
  void setChildren(std::uint32_t number, const Children& children);
  void replaceChild(std::uint32_t parent, std::uint32_t before, std::uint32_t after);
  std::uint32_t joinWithNearest(std::uint32_t parent, std::uint32_t added);
  void refit(std::uint32_t number);
  void widenCone(std::uint32_t number, const TreeNode& below);

  std::vector<TreeNode> nodes_;
  std::vector<std::uint32_t> first_child_;  ///< in the row; never falls from node to node
  std::uint32_t next_child_ = 1;
  std::vector<bool> is_edited_;                         ///< whether a node's children are no longer those of the row
  std::unordered_map<std::uint32_t, Children> edited_;  ///< then its children
  std::unordered_map<std::uint32_t, std::uint32_t> parents_;  ///< of nodes with another parent than in the row
  std::uint32_t root_ = 0;
};

}  // namespace lod::qsplat::builder
