#include "lod/qsplat/builder/lone_leaves.h"

#include <algorithm>

#include "lod/qsplat/builder/editable_tree.h"

namespace lod::qsplat::builder {
namespace {

// Coded spheres so many times as large as usual ones are too large. A choice: those of surfaces reach 4 times (their
// own size counts where that is more), and smaller limits would repeat more leaves.
constexpr float kTooLarge = 4.0F;
// Nodes so many times as large as one of their children, and as usual leaves, are widened.
constexpr float kLone = 8.0F;
// By so much. What touches a sphere at a pole cannot be coded smaller than the whole sphere, since a coded sphere's
// cube lies within its parent's. Two thirteenths reach 12.4 thirteenths of the way to a pole, and a child of an eighth
// or less stays below that.
constexpr float kWider = 1.09F;
// A node above one leaf is so large beside the one above it that its code stays two thirteenths, and the leaf is away
// from its own poles.
constexpr float kRoom = 0.02F;
constexpr std::size_t kMostNested = 6;  // nodes above each other; each is at most a sixth of the one before

constexpr std::uint64_t kLeastAdded = 1024;
constexpr std::uint64_t kAddedShare = 16;  // one leaf in so many

base::Sphere coded(const base::Sphere& parent, const base::Sphere& child) {
  return decodeSphere(parent, sphereTable()[encodeSphere(parent, child)]);
}

// The leaf below nodes of its own, breadth first. They hold it at most `most` times.
std::vector<TreeNode> nested(const TreeNode& leaf, const LargeLeaf& large, float usual, std::uint64_t most) {
  std::vector<base::Sphere> above;
  base::Sphere decoded = large.parent;
  float radius = large.radius;
  while (isTooLarge(radius, leaf.sphere.radius, usual) && above.size() < kMostNested &&
         std::uint64_t{2} << above.size() <= most) {
    base::Sphere around{leaf.sphere.center, std::max(leaf.sphere.radius, kRoom * decoded.radius)};
    if (!encloses(decoded, around)) around = leaf.sphere;
    const base::Sphere below = coded(decoded, around);
    if (below.radius > 0.5F * decoded.radius) break;  // at a pole
    above.push_back(around);
    decoded = below;
    radius = coded(decoded, leaf.sphere).radius;
  }
  if (above.empty()) return {};
  const std::uint32_t cone = encodeCone(static_cast<double>(cosineOfCone(leaf)));
  std::vector<TreeNode> nodes;
  for (std::size_t level = 0; level < above.size(); ++level) {
    TreeNode node = leaf;
    node.sphere = above[level];
    node.bits = packNode(0, Node{leaf.bits, 0}.normalCode(), cone, 2, level + 1 == above.size());
    nodes.insert(nodes.end(), std::size_t{1} << level, node);
  }
  nodes.insert(nodes.end(), std::size_t{1} << above.size(), leaf);
  return nodes;
}

}  // namespace

float usualRadius(std::span<const TreeNode> nodes) {
  std::vector<float> radii;
  for (const TreeNode& node : nodes)
    if (Node{node.bits, 0}.isLeaf()) radii.push_back(node.sphere.radius);
  if (radii.empty()) return 0.0F;
  const auto middle = radii.begin() + static_cast<std::ptrdiff_t>(radii.size() / 2);
  std::nth_element(radii.begin(), middle, radii.end());
  return *middle;
}

bool isTooLarge(float coded, float own, float usual) {
  return coded > kTooLarge * std::max(own, usual);
}

bool widenAroundLone(std::span<TreeNode> nodes) {
  const float usual = usualRadius(nodes);
  std::vector<bool> widened(nodes.size(), false);
  bool any = false;
  std::size_t end = nodes.size();  // behind the node's children
  for (std::size_t i = nodes.size(); i-- > 0;) {
    const std::size_t first = end - Node{nodes[i].bits, 0}.children();
    base::Sphere& sphere = nodes[i].sphere;
    std::array<base::Sphere, kMaxChildren> spheres;
    bool refit = false, lone = false;
    for (std::size_t c = first; c < end; ++c) {
      spheres[c - first] = nodes[c].sphere;
      refit |= widened[c] && !encloses(sphere, nodes[c].sphere);
      lone |= sphere.radius > kLone * std::max(nodes[c].sphere.radius, usual);
    }
    if (refit) sphere = enclosingSphere(std::span(spheres).first(end - first));
    if (lone) sphere.radius *= kWider;
    widened[i] = refit || lone;
    any |= widened[i];
    end = first;
  }
  return any;
}

NestedLeaves nestLargeLeaves(std::vector<TreeNode> nodes, std::vector<LargeLeaf> large, float usual) {
  std::sort(large.begin(), large.end(), [](const LargeLeaf& a, const LargeLeaf& b) {
    return a.radius != b.radius ? a.radius > b.radius : a.node < b.node;
  });
  const auto leaves = static_cast<std::uint64_t>(std::count_if(nodes.begin(), nodes.end(), [](const TreeNode& node) {
    return Node{node.bits, 0}.isLeaf();
  }));
  const std::uint64_t most = std::max(kLeastAdded, leaves / kAddedShare);
  NestedLeaves out;
  EditableTree tree(std::move(nodes));
  for (const LargeLeaf& leaf : large) {
    const std::vector<TreeNode> instead = nested(tree.node(leaf.node), leaf, usual, most - out.added_leaves);
    if (instead.empty()) continue;
    out.added_leaves += instead.size() / 2;  // 2^k leaves below 2^k − 1 nodes
    tree.replaceLeaf(leaf.node, instead);
  }
  out.nodes = tree.nodesFrom(tree.root());
  return out;
}

}  // namespace lod::qsplat::builder
