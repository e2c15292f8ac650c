#include "lod/qsplat/builder/editable_tree.h"

#include <algorithm>

namespace lod::qsplat::builder {
namespace {

// The mean of two colours by the areas of their nodes' discs.
std::uint16_t mixedColor(const TreeNode& a, const TreeNode& b) {
  const float area_a = a.sphere.radius * a.sphere.radius;
  const float area_b = b.sphere.radius * b.sphere.radius;
  const float share = area_a + area_b > 0.0F ? area_a / (area_a + area_b) : 0.5F;
  const auto channel = [&](unsigned shift, unsigned mask) {
    const auto value = [&](const TreeNode& node) { return static_cast<float>(node.color >> shift & mask); };
    return static_cast<unsigned>(share * value(a) + (1.0F - share) * value(b) + 0.5F) << shift;
  };
  return static_cast<std::uint16_t>(channel(11, 31U) | channel(5, 63U) | channel(0, 31U));
}

}  // namespace

EditableTree::EditableTree(std::vector<TreeNode> nodes)
    : nodes_(std::move(nodes)), is_edited_(nodes_.size(), false), root_(nodes_.empty() ? kNone : 0) {
  first_child_.reserve(nodes_.size());
  for (const TreeNode& node : nodes_) {
    first_child_.push_back(next_child_);
    next_child_ += Node{node.bits, 0}.children();
  }
}

// Numbers go on where those of the nodes before ended, so the row's rule for children holds for them, too.
std::uint32_t EditableTree::append(std::span<const TreeNode> nodes) {
  const auto first = static_cast<std::uint32_t>(nodes_.size());
  next_child_ = first + 1;
  for (const TreeNode& node : nodes) {
    nodes_.push_back(node);
    first_child_.push_back(next_child_);
    next_child_ += Node{node.bits, 0}.children();
  }
  is_edited_.resize(nodes_.size(), false);
  return first;
}

std::uint32_t EditableTree::parent(std::uint32_t number) const {
  if (number == root_) return kNone;
  if (const auto found = parents_.find(number); found != parents_.end()) return found->second;
  // The last node whose children begin at this number or before it.
  const auto after = std::upper_bound(first_child_.begin(), first_child_.end(), number);
  return static_cast<std::uint32_t>(after - first_child_.begin()) - 1;
}

std::vector<std::uint32_t> EditableTree::order(std::uint32_t from) const {
  std::vector<std::uint32_t> out{from};
  if (from == 0) out.reserve(nodes_.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Children below = children(out[i]);
    out.insert(out.end(), below.numbers.begin(), below.numbers.begin() + below.count);
  }
  return out;
}

std::vector<TreeNode> EditableTree::nodesFrom(std::uint32_t number) const {
  std::vector<TreeNode> out;
  const std::vector<std::uint32_t> numbers = order(number);
  out.reserve(numbers.size());
  for (const std::uint32_t at : numbers) {
    out.push_back(nodes_[at]);
    const Children below = children(at);
    const auto all = below.view();
    const bool above_leaves =
        !all.empty() && std::all_of(all.begin(), all.end(), [this](std::uint32_t child) { return isLeaf(child); });
    const Node node{nodes_[at].bits, 0};
    out.back().bits = packNode(0, node.normalCode(), node.coneCode(), below.count, above_leaves);
  }
  return out;
}

// ---- edits ----

void EditableTree::setChildren(std::uint32_t number, const Children& children) {
  is_edited_[number] = true;
  edited_[number] = children;
  for (const std::uint32_t child : children.view()) parents_[child] = number;
}

void EditableTree::replaceChild(std::uint32_t parent, std::uint32_t before, std::uint32_t after) {
  if (parent == kNone) {
    root_ = after;
    return;
  }
  Children all = children(parent);
  *std::find(all.numbers.begin(), all.numbers.begin() + all.count, before) = after;
  setChildren(parent, all);
}

void EditableTree::remove(std::uint32_t number) {
  if (number == root_) {
    root_ = kNone;
    return;
  }
  const std::uint32_t above = parent(number);
  Children left = children(above);
  const auto end = left.numbers.begin() + left.count;
  left.count = static_cast<std::uint32_t>(std::remove(left.numbers.begin(), end, number) - left.numbers.begin());
  if (left.count > 1) {
    setChildren(above, left);
    return refit(above);
  }
  const std::uint32_t over = parent(above);
  replaceChild(over, above, left.numbers[0]);
  refit(over);
}

void EditableTree::add(std::uint32_t parent, std::span<const TreeNode> nodes) {
  const std::uint32_t added = append(nodes);
  Children all = children(parent);
  if (all.count < kMaxChildren) {
    all.numbers[all.count++] = added;
    setChildren(parent, all);
    refit(parent);
  } else {
    refit(joinWithNearest(parent, added));
  }
  for (std::uint32_t i = parents_[added]; i != kNone; i = this->parent(i)) widenCone(i, nodes_[added]);
}

void EditableTree::replaceLeaf(std::uint32_t leaf, std::span<const TreeNode> nodes) {
  const std::uint32_t above = parent(leaf);
  replaceChild(above, leaf, append(nodes));
}

// Puts a node above the added one and the child that is nearest to it, in that child's place.
std::uint32_t EditableTree::joinWithNearest(std::uint32_t parent, std::uint32_t added) {
  const auto radiusWith = [&](std::uint32_t child) {
    const std::array<base::Sphere, 2> both{nodes_[child].sphere, nodes_[added].sphere};
    return enclosingSphere(both).radius;
  };
  const Children all = children(parent);
  const std::uint32_t nearest =
      *std::min_element(all.view().begin(), all.view().end(),
                        [&](std::uint32_t a, std::uint32_t b) { return radiusWith(a) < radiusWith(b); });
  TreeNode joint;
  joint.bits = packNode(0, Node{nodes_[nearest].bits, 0}.normalCode(), 0, 2, false);
  joint.color = mixedColor(nodes_[nearest], nodes_[added]);
  const std::uint32_t number = append(std::span(&joint, 1));
  replaceChild(parent, nearest, number);
  setChildren(number, {2, {nearest, added}});
  widenCone(number, nodes_[nearest]);
  return number;
}

// Computes the spheres of a node and of those above it from their children.
void EditableTree::refit(std::uint32_t number) {
  for (; number != kNone; number = parent(number)) {
    std::array<base::Sphere, kMaxChildren> spheres;
    const Children below = children(number);
    for (std::size_t i = 0; i < below.count; ++i) spheres[i] = nodes_[below.numbers[i]].sphere;
    nodes_[number].sphere = enclosingSphere(std::span(spheres).first(below.count));
  }
}

void EditableTree::widenCone(std::uint32_t number, const TreeNode& below) {
  const Node node{nodes_[number].bits, 0};
  const float along =
      glm::dot(normalTable()[node.normalCode()], normalTable()[Node{below.bits, 0}.normalCode()]) - kCosineRounding;
  const float cosine = cosineOfCone(below);
  const float least = cosineOfSum(std::min(1.0F, along), cosine, sineOf(cosine));
  const std::uint32_t cone = std::max(node.coneCode(), encodeCone(static_cast<double>(least)));
  nodes_[number].bits = packNode(0, node.normalCode(), cone, node.children(), node.childrenAreLeaves());
}

}  // namespace lod::qsplat::builder
