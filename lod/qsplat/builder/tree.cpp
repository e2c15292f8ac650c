#include "lod/qsplat/builder/tree.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace lod::qsplat::builder {
namespace {

// An inner node's normal may be turned by this many radians for a narrower cone, before it is coded
// (docs/results/qsplat.md has the share of nodes that are). A choice: a larger turn narrows more cones and changes
// shading more.
constexpr float kMaxTurn = 0.05F;
// Half the side of a normal's cell, by which coding may move a normal.
constexpr float kHalfCell = 0.012F;

// The width of a cone. There is one for each code, and a last one from which a turn may still reach a code.
struct ConeWidth {
  float angle = 0.0F;
  float cosine = 0.0F;  // raised by more than encodeCone() rounds down
  float sine = 0.0F;
  float core = 0.0F;  // cosine of the angle minus the half-angle of LeafFacets' narrow cone
};
const std::array<ConeWidth, kAnyDirection + 1> kWidths = [] {
  std::array<ConeWidth, kAnyDirection + 1> widths{};
  for (std::uint32_t code = 0; code <= kAnyDirection; ++code) {
    ConeWidth& width = widths[code];
    width.angle = code < kAnyDirection ? std::asin(coneSines(true)[code]) : widths[code - 1].angle + kMaxTurn;
    width.cosine = std::cos(width.angle) + 2e-6F;
    width.sine = std::sin(width.angle);
    width.core = width.cosine * LeafFacets::kCoreCosine + width.sine * LeafFacets::kCoreSine;
  }
  return widths;
}();
constexpr std::uint32_t kTooWide = kAnyDirection + 1;

// Splits that leave less than a sixteenth on one side, from a tree's root down to a leaf. A choice: more of them
// separate strays at more distances, and let trees get deeper.
constexpr std::uint32_t kMaxUnevenSplits = 24;

// Leaves lie in the source's order, which may be random, so they are prefetched this many ahead.
constexpr std::uint32_t kPrefetchDistance = 8;

constexpr std::uint8_t kPointerBit = 0x80;  // in a group's byte, where it has a pointer

class TreeMaker {
 public:
  TreeMaker(std::span<const Splat> splats, const LeafFacets& facets)
      : splats_(splats), facets_(facets), keys_(splats.size()), cones_(splats.size()) {
    for (std::uint32_t i = 0; i < keys_.size(); ++i) keys_[i] = {splats[i].sphere.center, splats[i].sphere.radius, i};
    shape_.inner.reserve(splats.size() / 2);
    farthest_.reserve(splats.size() / 2);
  }
  TreeShape run() {
    shape_.root = make(rangeOf(0, static_cast<std::uint32_t>(keys_.size()), kMaxUnevenSplits));
    return std::move(shape_);
  }

 private:
  struct Key {
    glm::vec3 center;
    float radius;
    std::uint32_t index;
  };
  struct Range {  // a range of keys_
    std::uint32_t begin = 0, end = 0;
    std::uint32_t uneven_left = 0;  // uneven splits that it and its parts may still undergo, one after the other
    base::Aabb box;                 // around the centres
    float reach = 0.0F;             // half the box's diagonal
    bool has_gaps = false;          // its splats are farther apart than their own sizes allow

    std::uint32_t size() const { return end - begin; }
  };

  Range rangeOf(std::uint32_t begin, std::uint32_t end, std::uint32_t uneven_left) const {
    Range out;
    out.begin = begin;
    out.end = end;
    out.uneven_left = uneven_left;
    double squares = 0.0;
    for (std::uint32_t i = begin; i < end; ++i) {
      out.box.add(keys_[i].center);
      squares += static_cast<double>(keys_[i].radius) * static_cast<double>(keys_[i].radius);
    }
    out.reach = 0.5F * glm::length(out.box.size());
    out.has_gaps = isSpread(out.reach, squares);
    return out;
  }

  // A node merges binary splits: sets with gaps are split first, the widest of them, and then the largest set, until
  // there are four. Sets of at most four splats without gaps stay together as one child, so that the lowest nodes,
  // which are the most, are full. Free places then take the splats of small sets.
  std::uint32_t make(const Range& whole) {
    if (whole.size() == 1) {
      const std::uint32_t leaf = keys_[whole.begin].index;
      cones_[whole.begin] = coneOf(leaf);
      return TreeShape::kLeaf | leaf;
    }
    prefetch(whole);
    std::array<Range, kMaxChildren> parts{whole};
    std::uint32_t count = 1;
    const auto bySize = [](const Range& a, const Range& b) { return a.size() < b.size(); };
    const auto byUrgency = [](const Range& a, const Range& b) {
      if (a.has_gaps != b.has_gaps) return b.has_gaps;
      return a.has_gaps ? a.reach < b.reach : a.size() < b.size();
    };
    while (count < kMaxChildren) {
      const auto next = std::max_element(parts.begin(), parts.begin() + count, byUrgency);
      if (next->size() <= kMaxChildren && !next->has_gaps) break;
      parts[count++] = split(*next);
    }
    while (count < kMaxChildren) {
      Range* opened = nullptr;
      for (std::uint32_t i = 0; i < count; ++i)
        if (parts[i].size() > 1 && count + parts[i].size() - 1 <= kMaxChildren &&
            (opened == nullptr || bySize(*opened, parts[i])))
          opened = &parts[i];
      if (opened == nullptr) break;
      for (; opened->size() > 1; --opened->end) parts[count++] = rangeOf(opened->end - 1, opened->end, 0);
    }

    TreeShape::InnerNode node;
    node.count = count;
    for (std::uint32_t i = 0; i < count; ++i) node.children[i] = make(parts[i]);
    std::array<const Splat*, kMaxChildren> children{};
    for (std::uint32_t i = 0; i < count; ++i) children[i] = &splatOf(node.children[i]);
    node.splat = parentOf(std::span(children).first(count));
    std::array<glm::vec3, kMaxChildren> farthest{};
    std::uint32_t known = 0;
    for (std::uint32_t i = 0; i < count; ++i)
      if ((node.children[i] & TreeShape::kLeaf) == 0) farthest[known++] = farthest_[node.children[i]];
    farthest_.push_back(setCone(whole, std::span(farthest).first(known), node.splat));
    shape_.inner.push_back(node);
    return static_cast<std::uint32_t>(shape_.inner.size() - 1);
  }

  // A leaf's cone. Inner nodes read them again and again, so they lie in the order of keys_.
  struct LeafCone {
    glm::vec3 axis{0.0F};  // the decoded normal
    float cosine = 0.0F;   // cosine of its half-angle
    float sine = 0.0F;
    std::uint32_t first = 0, last = 0;  // its facets
  };
  LeafCone coneOf(std::uint32_t leaf) const {
    const Splat& splat = splats_[leaf];
    const float cosine = splat.least_cosine;
    LeafCone cone{normalTable()[splat.direction], cosine, sineOf(cosine)};
    if (!facets_.empty()) cone.first = facets_.first[leaf], cone.last = facets_.first[leaf + 1];
    return cone;
  }

  // The cone around an axis that covers a range of leaves.
  struct Cone {
    std::uint32_t width = 0;  // place in kWidths, or kTooWide
    float farthest = 1.0F;    // cosine of the farthest normal of those that widened it
    glm::vec3 towards{0.0F};  // that normal, or the axis of its leaf's cone

    void add(float cosine, const glm::vec3& normal) {
      if (cosine >= farthest) return;
      farthest = cosine;
      towards = normal;
      while (width < kTooWide && !(cosine >= kWidths[width].cosine)) ++width;
    }
    float least() const { return width < kAnyDirection ? kWidths[width].cosine : -1.0F; }
  };

  // Measures the cone over the leaves themselves, since cones around the children's cones would widen from level to
  // level. Where a leaf's cone would widen it, the leaf's facets are measured, which leave most of their cone empty.
  // Stops where it is wider than `max_width`. `farthest` are the children's farthest normals, which determine most
  // nodes at once.
  Cone coneAround(const Range& part, const glm::vec3& axis, std::span<const glm::vec3> farthest,
                  std::uint32_t max_width) const {
    Cone out{0, 1.0F, axis};
    for (const glm::vec3& normal : farthest) out.add(glm::dot(axis, normal), normal);
    for (std::uint32_t i = part.begin; i < part.end && out.width <= max_width; ++i) {
      const LeafCone& leaf = cones_[i];
      const ConeWidth& width = kWidths[out.width];
      const float along = glm::dot(axis, leaf.axis);
      // The leaf's cone fits: the angle between the axes plus the leaf's half-angle is at most the width.
      if (leaf.cosine >= width.cosine && along - kCosineRounding >= width.cosine * leaf.cosine + width.sine * leaf.sine)
        continue;
      if (leaf.first == leaf.last) {
        out.add(cosineOfSum(std::min(1.0F, along), leaf.cosine, leaf.sine), leaf.axis);
        continue;
      }
      const bool core_fits = along >= width.core;
      float least = core_fits ? 1.0F : cosineOfSum(along, LeafFacets::kCoreCosine, LeafFacets::kCoreSine);
      const glm::vec3* towards = &leaf.axis;
      for (std::uint32_t f = leaf.first; f < leaf.last; ++f) {
        const float cosine = glm::dot(axis, facets_.normals[f]);
        towards = cosine < least ? &facets_.normals[f] : towards;
        least = std::min(cosine, least);
      }
      out.add(least, *towards);
    }
    return out;
  }

  // Sets the cone around a node's normal. Cones have few codes, so where a small turn allows a narrower one, the normal
  // is turned towards the farthest normal, which is returned.
  glm::vec3 setCone(const Range& part, std::span<const glm::vec3> farthest, Splat& splat) const {
    const glm::vec3& axis = normalTable()[splat.direction];
    const Cone cone = coneAround(part, axis, farthest, kAnyDirection);
    splat.least_cosine = cone.least();
    if (cone.width == 0 || cone.width == kTooWide) return cone.towards;
    const ConeWidth& narrower = kWidths[cone.width - 1];
    const float turn = std::acos(cone.farthest) - narrower.angle + kHalfCell;
    const glm::vec3 across = cone.towards - axis * glm::dot(axis, cone.towards);
    if (turn > kMaxTurn || !(glm::dot(across, across) > 0.0F)) return cone.towards;
    const std::uint32_t turned = encodeNormal(std::cos(turn) * axis + std::sin(turn) * glm::normalize(across));
    const Cone other = coneAround(part, normalTable()[turned], farthest, cone.width - 1);
    if (other.width >= cone.width) return cone.towards;
    splat.direction = turned;
    splat.least_cosine = other.least();
    return other.towards;
  }

  // Prefetches the leaves that coneOf() will read, and, once there are few of them, what they point to.
  void prefetch(const Range& part) const {
    if (part.size() > 4 * kPrefetchDistance) return;
    for (std::uint32_t i = part.begin; i < part.end; ++i) {
      const std::uint32_t leaf = keys_[i].index;
      const Splat& splat = splats_[leaf];
      if (part.size() > kPrefetchDistance) {
        __builtin_prefetch(&splat);
        __builtin_prefetch(&splat.least_cosine);
        if (!facets_.empty()) __builtin_prefetch(&facets_.first[leaf]);
      } else {
        __builtin_prefetch(&normalTable()[splat.direction]);
        if (!facets_.empty()) __builtin_prefetch(facets_.normals.data() + facets_.first[leaf]);
      }
    }
  }

  const Splat& splatOf(std::uint32_t child) const {
    return (child & TreeShape::kLeaf) != 0 ? splats_[child & ~TreeShape::kLeaf] : shape_.inner[child].splat;
  }

  // Splits a set in two by reordering it; `part` keeps the first, and the second is returned. The middle of the box may
  // leave few splats on one side, such as a stray point far from a surface. Then it is the right place, but a tree
  // must not get deep by such splits, so only some of them are allowed.
  Range split(Range& part) {
    const glm::vec3 size = part.box.size();
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const float middle = part.box.min[axis] + 0.5F * size[axis];
    const auto first = keys_.begin() + part.begin;
    const auto last = keys_.begin() + part.end;
    const auto at = std::partition(first, last, [&](const Key& key) { return key.center[axis] < middle; });
    const auto before = static_cast<std::uint32_t>(at - first);
    const bool uneven = std::min(before, part.size() - before) <= part.size() / 16;
    const bool by_count = uneven && (part.uneven_left == 0 || before == 0 || before == part.size());
    if (uneven && !by_count) --part.uneven_left;
    const std::uint32_t halves = by_count ? part.size() / 2 : before;
    const std::uint32_t place = wholeNodes(halves, part.size());
    if (place != before) sortAround(part, place, axis);
    auto cut = cutAt(part, place);
    if (place != halves && (cut.first.has_gaps || cut.second.has_gaps)) {
      sortAround(part, halves, axis);
      cut = cutAt(part, halves);
    }
    part = cut.first;
    return cut.second;
  }

  // Puts the splats that are least along the axis before the others.
  void sortAround(const Range& part, std::uint32_t place, int axis) {
    const auto first = keys_.begin() + part.begin;
    std::nth_element(first, first + place, keys_.begin() + part.end, [&](const Key& a, const Key& b) {
      return a.center[axis] != b.center[axis] ? a.center[axis] < b.center[axis] : a.index < b.index;
    });
  }

  std::pair<Range, Range> cutAt(const Range& part, std::uint32_t place) const {
    return {rangeOf(part.begin, part.begin + place, part.uneven_left),
            rangeOf(part.begin + place, part.end, part.uneven_left)};
  }

  // A small set is split at the multiple of four nearest to `before`, so that its nodes of leaves are full. In larger
  // sets that would save hardly any bytes, and spheres would get larger.
  static std::uint32_t wholeNodes(std::uint32_t before, std::uint32_t all) {
    const std::uint32_t step = all >= 8 && all < 32 ? kMaxChildren : 1;
    return std::clamp((before + step / 2) / step * step, step, all - step);
  }

  std::span<const Splat> splats_;
  const LeafFacets& facets_;
  std::vector<Key> keys_;
  std::vector<LeafCone> cones_;  // in the order of keys_, as far as that is final
  TreeShape shape_;
  std::vector<glm::vec3> farthest_;  // by inner node: the normal farthest from its axis
};

}  // namespace

float cosineOfCone(const TreeNode& node) {
  const Node word{node.bits, 0};
  const float sine = word.isLeaf() ? coneSines(false)[node.leaf_cone] : coneSines(true)[word.coneCode()];
  return sine < 1.0F ? std::sqrt(1.0F - sine * sine) - kCosineRounding : -1.0F;
}

TreeNode nodeFor(const Splat& splat, std::uint32_t children, bool children_are_leaves) {
  TreeNode node;
  node.sphere = splat.sphere;
  node.bits =
      packNode(0, splat.direction, encodeCone(static_cast<double>(splat.least_cosine)), children, children_are_leaves);
  node.color = encodeColor(splat.meanColor());
  if (children == 0)
    node.leaf_cone = static_cast<std::uint16_t>(encodeLeafCone(static_cast<double>(splat.least_cosine)));
  return node;
}

TreeShape makeTree(std::span<const Splat> splats, const LeafFacets& facets) {
  LUMIGRID_CHECK(!splats.empty());
  return TreeMaker(splats, facets).run();
}

Subtree makeSubtree(std::span<const Splat> leaves, const LeafFacets& facets) {
  const TreeShape shape = makeTree(leaves, facets);
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
      if (i + kPrefetchDistance < level.size() && isLeaf(level[i + kPrefetchDistance]))
        __builtin_prefetch(&leaves[level[i + kPrefetchDistance] & ~TreeShape::kLeaf]);
      if (isLeaf(child)) {
        out.nodes.push_back(nodeFor(leaves[child & ~TreeShape::kLeaf], 0, false));
        continue;
      }
      const TreeShape::InnerNode& inner = shape.inner[child];
      const auto children = std::span(inner.children).first(inner.count);
      out.nodes.push_back(nodeFor(inner.splat, inner.count, std::all_of(children.begin(), children.end(), isLeaf)));
      next.insert(next.end(), children.begin(), children.end());
    }
    out.level_nodes.push_back(static_cast<std::uint32_t>(level.size()));
    std::swap(level, next);
  }
  return out;
}

void appendGroup(Run& run, const GroupNodes& group, bool colors) {
  const GroupLayout layout(colors, false);
  const std::size_t at = run.size();
  run.resize(at + 1 + layout.bytes(group.count, false));
  run[at] = static_cast<std::uint8_t>(group.count | (group.has_pointer ? kPointerBit : 0U));
  writeNodes(group, layout, &run[at + 1]);
}

GroupNodes readGroup(base::ByteView run, std::size_t& at, bool colors) {
  const GroupLayout layout(colors, false);
  if (at >= run.size()) return {};
  GroupNodes group;
  group.count = run[at] & (kPointerBit - 1U);
  group.has_pointer = (run[at] & kPointerBit) != 0;
  if (group.count > group.nodes.size() || run.size() - at < 1 + layout.bytes(group.count, false)) return {};
  for (std::uint32_t i = 0; i < group.count; ++i) group.nodes[i] = readNode(&run[at + 1], i, layout);
  at += 1 + layout.bytes(group.count, false);
  return group;
}

std::vector<Run> encodeSubtree(std::span<const TreeNode> nodes, const base::Sphere& root, bool colors,
                               LeafCones leaf_cones, const VisitLeaf& visit_leaf) {
  const SphereTable& table = sphereTable();
  std::vector<Run> runs;
  std::vector<base::Sphere> level{root};  // the decoded spheres of a level
  std::vector<base::Sphere> next;
  GroupNodes group;
  std::size_t first = 0;  // number of the level's first node
  while (true) {
    next.clear();
    Run run;
    std::size_t child = first + level.size();
    for (std::size_t i = 0; i < level.size(); ++i) {
      const Node parent{nodes[first + i].bits, 0};
      group.count = parent.children();
      group.has_pointer = !parent.childrenAreLeaves();
      if (group.count == 0) continue;
      for (std::uint32_t c = 0; c < group.count; ++c, ++child) {
        const std::uint32_t code = encodeSphere(level[i], nodes[child].sphere);
        group.nodes[c] = nodes[child].encoded(code, group.has_pointer, leaf_cones);
        next.push_back(decodeSphere(level[i], table[code]));
        if (visit_leaf && Node{nodes[child].bits, 0}.isLeaf())
          visit_leaf(static_cast<std::uint32_t>(child), next.back().radius, level[i]);
      }
      appendGroup(run, group, colors);
    }
    if (next.empty()) return runs;
    runs.push_back(std::move(run));
    first += level.size();
    std::swap(level, next);
  }
}

}  // namespace lod::qsplat::builder
