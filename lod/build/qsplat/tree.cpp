#include "lod/build/qsplat/tree.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace lod::build::qsplat {
namespace {

using lod::qsplat::kMostChildren;

// Of the widest cone that has a code, or a little wider.
const float kWidestCosine = [] {
  const float sine = lod::qsplat::coneSines(true)[lod::qsplat::kAnyDirection - 1];
  return std::sqrt(1.0F - sine * sine) - 1e-3F;
}();

// Leaves lie in the source's order, which may be none: they are asked for so many ahead.
constexpr std::uint32_t kAhead = 8;

class TreeMaker {
 public:
  explicit TreeMaker(std::span<const Splat> splats) : splats_(splats), keys_(splats.size()) {
    for (std::uint32_t i = 0; i < keys_.size(); ++i) keys_[i] = {splats[i].sphere.center, i};
    shape_.inner.reserve(splats.size() / 2);
  }
  TreeShape run() {
    shape_.root = make({0, static_cast<std::uint32_t>(keys_.size())});
    return std::move(shape_);
  }

 private:
  struct Key {
    glm::vec3 center;
    std::uint32_t index;
  };
  struct Part {
    std::uint32_t begin = 0, end = 0;
    std::uint32_t size() const { return end - begin; }
  };

  // Binary splits merged: the part with most splats is split until there are four. Parts that are all a node's children
  // stay together, so that nodes are full where there is most of them; with the places left, smaller ones are opened.
  std::uint32_t make(const Part& whole) {
    if (whole.size() == 1) return TreeShape::kLeaf | keys_[whole.begin].index;
    std::array<Part, kMostChildren> parts{whole};
    std::uint32_t count = 1;
    const auto bySize = [](const Part& a, const Part& b) { return a.size() < b.size(); };
    while (count < kMostChildren) {
      const auto largest = std::max_element(parts.begin(), parts.begin() + count, bySize);
      if (largest->size() <= kMostChildren) break;
      const std::uint32_t middle = split(*largest);
      parts[count++] = {middle, largest->end};
      largest->end = middle;
    }
    while (count < kMostChildren) {
      Part* opened = nullptr;
      for (std::uint32_t i = 0; i < count; ++i)
        if (parts[i].size() > 1 && count + parts[i].size() - 1 <= kMostChildren &&
            (opened == nullptr || bySize(*opened, parts[i])))
          opened = &parts[i];
      if (opened == nullptr) break;
      while (opened->size() > 1) parts[count++] = {opened->end - 1, opened->end}, --opened->end;
    }

    TreeShape::Inner node;
    node.count = count;
    for (std::uint32_t i = 0; i < count; ++i) node.children[i] = make(parts[i]);
    std::array<const Splat*, kMostChildren> children{};
    for (std::uint32_t i = 0; i < count; ++i) children[i] = &splatOf(node.children[i]);
    node.splat = parentOf(std::span(children).first(count));
    node.splat.least_cosine = coneOver(whole, lod::qsplat::normalTable()[node.splat.direction]);
    shape_.inner.push_back(node);
    return static_cast<std::uint32_t>(shape_.inner.size() - 1);
  }

  // Over the splats themselves: cones around cones would widen from level to level. One that is too wide for any code
  // is given up at the first splat that says so.
  float coneOver(const Part& part, const glm::vec3& axis) const {
    float least = 1.0F;
    for (std::uint32_t i = part.begin; i < part.end; ++i) {
      if (i + kAhead < part.end) __builtin_prefetch(&splats_[keys_[i + kAhead].index].direction);
      least = std::min(least, leastCosine(axis, splats_[keys_[i].index]));
      if (least < kWidestCosine) return -1.0F;
    }
    return least;
  }

  const Splat& splatOf(std::uint32_t child) const {
    return (child & TreeShape::kLeaf) != 0 ? splats_[child & ~TreeShape::kLeaf] : shape_.inner[child].splat;
  }

  // Reorders the part so that what is before the place returned, and what is not, are its two halves.
  std::uint32_t split(const Part& part) {
    base::Aabb box;
    for (std::uint32_t i = part.begin; i < part.end; ++i) box.add(keys_[i].center);
    const glm::vec3 size = box.size();
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const float middle = box.min[axis] + 0.5F * size[axis];
    const auto first = keys_.begin() + part.begin;
    const auto last = keys_.begin() + part.end;
    const auto at = std::partition(first, last, [&](const Key& key) { return key.center[axis] < middle; });
    const auto before = static_cast<std::uint32_t>(at - first);
    const bool degenerate = std::min(before, part.size() - before) <= part.size() / 16;
    const std::uint32_t place = wholeNodes(degenerate ? part.size() / 2 : before, part.size());
    if (place != before)
      std::nth_element(first, first + place, last, [&](const Key& a, const Key& b) {
        return a.center[axis] != b.center[axis] ? a.center[axis] < b.center[axis] : a.index < b.index;
      });
    return part.begin + place;
  }

  // Few splats are split where full nodes of leaves come out: the nearest such number to `before`. (Among more of them
  // it saves no bytes that count, and spheres get larger.)
  static std::uint32_t wholeNodes(std::uint32_t before, std::uint32_t all) {
    const std::uint32_t step = all >= 8 && all < 32 ? kMostChildren : 1;
    return std::clamp((before + step / 2) / step * step, step, all - step);
  }

  std::span<const Splat> splats_;
  std::vector<Key> keys_;
  TreeShape shape_;
};

}  // namespace

TreeNode nodeFor(const Splat& splat, std::uint32_t children, bool children_are_leaves) {
  TreeNode node;
  node.sphere = splat.sphere;
  node.bits =
      lod::qsplat::packNode(0, splat.direction, lod::qsplat::encodeCone(static_cast<double>(splat.least_cosine)),
                            children, children_are_leaves);
  node.color = lod::qsplat::encodeColor(splat.meanColor());
  if (children == 0)
    node.leaf_cone = static_cast<std::uint16_t>(lod::qsplat::encodeLeafCone(static_cast<double>(splat.least_cosine)));
  return node;
}

TreeShape makeTree(std::span<const Splat> splats) {
  LUMIGRID_CHECK(!splats.empty());
  return TreeMaker(splats).run();
}

Subtree makeSubtree(std::span<const Splat> leaves) {
  const TreeShape shape = makeTree(leaves);
  Subtree out;
  out.nodes.reserve(leaves.size() + shape.inner.size());
  const auto isLeaf = [](std::uint32_t child) { return (child & TreeShape::kLeaf) != 0; };
  out.root = isLeaf(shape.root) ? leaves[shape.root & ~TreeShape::kLeaf] : shape.inner[shape.root].splat;
  std::vector<std::uint32_t> level{shape.root};
  std::vector<std::uint32_t> next;
  while (!level.empty()) {
    next.clear();
    for (std::size_t i = 0; i < level.size(); ++i) {
      const std::uint32_t child = level[i];
      if (i + kAhead < level.size() && isLeaf(level[i + kAhead]))
        __builtin_prefetch(&leaves[level[i + kAhead] & ~TreeShape::kLeaf]);
      if (isLeaf(child)) {
        out.nodes.push_back(nodeFor(leaves[child & ~TreeShape::kLeaf], 0, false));
        continue;
      }
      const TreeShape::Inner& inner = shape.inner[child];
      const auto children = std::span(inner.children).first(inner.count);
      out.nodes.push_back(nodeFor(inner.splat, inner.count, std::all_of(children.begin(), children.end(), isLeaf)));
      next.insert(next.end(), children.begin(), children.end());
    }
    out.level_nodes.push_back(static_cast<std::uint32_t>(level.size()));
    std::swap(level, next);
  }
  return out;
}

}  // namespace lod::build::qsplat
