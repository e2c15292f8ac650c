#include "lod/patch/proxy_sight.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "base/bytes.h"
#include "base/simd.h"
#include "lod/patch/ray_triangle.h"
#include "lod/patch/traverse.h"

namespace lod::patch {
namespace {

using base::Float4;

// Below this depth ranges are halved by number, so that the depth is bounded whatever the triangles are.
constexpr std::size_t kMaxUnevenDepth = 24;
// At most 2^32 triangles are halved 32 times below that; each level leaves three nodes to be visited.
constexpr std::size_t kMaxStack = 3 * (kMaxUnevenDepth + 32) + 5;
constexpr std::size_t kBins = 16;  // places between which a range may be divided; more cost time and gain little

struct Triangle {
  std::array<glm::vec3, 3> corners;
  glm::vec3 sum() const { return corners[0] + corners[1] + corners[2]; }
  base::Aabb box() const {
    base::Aabb box;
    for (const glm::vec3& corner : corners) box.add(corner);
    return box;
  }
};

float halfArea(const base::Aabb& box) {
  if (box.empty()) return 0.0F;
  const glm::vec3 size = box.size();
  return size.x * size.y + size.y * size.z + size.z * size.x;
}

LUMIGRID_ALWAYS_INLINE Float4 fourOf(float value) {
  return Float4{value, value, value, value};
}
}  // namespace

/// Divides triangles among boxes so that a ray meets few of them: by the surface area heuristic over bins of the
/// longest side (Wald 2007, "On fast construction of SAH-based bounding volume hierarchies"), into four at a time.
class ProxySight::Builder {
 public:
  Builder(std::vector<Triangle> triangles, std::vector<Node>& nodes, std::vector<Leaf>& leaves)
      : triangles_(std::move(triangles)), nodes_(nodes), leaves_(leaves) {}

  void build() {
    if (triangles_.empty()) return;
    leaves_.reserve(triangles_.size() / 3);
    addNode(rangeOf(0, static_cast<std::uint32_t>(triangles_.size())), 0);
  }

 private:
  struct Range {
    std::uint32_t first = 0, count = 0;
    base::Aabb box;
  };
  Range rangeOf(std::uint32_t first, std::uint32_t count) const {
    Range range{first, count, {}};
    for (std::uint32_t t = first; t < first + count; ++t) range.box.add(triangles_[t].box());
    return range;
  }

  std::uint32_t addNode(const Range& all, std::size_t depth) {
    const auto index = static_cast<std::uint32_t>(nodes_.size());
    nodes_.emplace_back();
    std::array<Range, kWidth> parts{all};
    std::size_t count = 1;
    while (count < kWidth) {
      // The largest box is met by most rays.
      std::size_t widest = count;
      float most = -1.0F;
      for (std::size_t i = 0; i < count; ++i) {
        const float area = parts[i].count > kWidth ? halfArea(parts[i].box) : -1.0F;
        if (area > most) widest = i, most = area;
      }
      if (widest == count) break;
      const auto [low, high] = divide(parts[widest], depth);
      parts[widest] = low;
      parts[count++] = high;
    }
    for (std::size_t i = 0; i < kWidth; ++i) {
      const base::Aabb box = i < count ? grown(parts[i].box) : nowhere();
      for (int axis = 0; axis < 3; ++axis) {
        nodes_[index].sides[0][axis][i] = box.min[axis];
        nodes_[index].sides[1][axis][i] = box.max[axis];
      }
      const std::uint32_t child = i >= count                 ? kIsLeaf
                                  : parts[i].count <= kWidth ? addLeaf(parts[i]) | kIsLeaf
                                                             : addNode(parts[i], depth + 1);
      nodes_[index].children[i] = child;
    }
    return index;
  }

  /// A box that compares as not met with every ray.
  static base::Aabb nowhere() {
    constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
    return {glm::vec3(kNothing), glm::vec3(kNothing)};
  }

  std::uint32_t addLeaf(const Range& range) {
    Leaf leaf;
    for (std::uint32_t place = 0; place < kWidth; ++place)
      for (std::size_t corner = 0; corner < 3; ++corner) {
        const bool is_there = place < range.count;
        const glm::vec3& at = triangles_[range.first + (is_there ? place : 0)].corners[is_there ? corner : 0];
        for (int axis = 0; axis < 3; ++axis) leaf.corners[corner][axis][place] = at[axis];
      }
    const auto middle = [](const Triangle& triangle) { return triangle.sum() / 3.0F; };
    leaf.cell.place = middle(triangles_[range.first]);
    for (std::uint32_t t = range.first; t < range.first + range.count; ++t)
      for (const glm::vec3& corner : triangles_[t].corners)
        leaf.cell.radius = std::max(leaf.cell.radius, glm::length(corner - leaf.cell.place));
    leaves_.push_back(leaf);
    return static_cast<std::uint32_t>(leaves_.size() - 1);
  }

  /// A little larger, so that rays within the plane of a side meet the box for certain.
  static base::Aabb grown(const base::Aabb& box) {
    constexpr float kWiden = 1e-6F, kWidenLeast = 1e-20F;
    return {box.min - kWiden * glm::abs(box.min) - kWidenLeast, box.max + kWiden * glm::abs(box.max) + kWidenLeast};
  }

  std::pair<Range, Range> divide(const Range& range, std::size_t depth) {
    base::Aabb centers;
    for (std::uint32_t t = range.first; t < range.first + range.count; ++t) centers.add(triangles_[t].sum());
    const glm::vec3 size = centers.size();
    const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
    std::uint32_t low = depth < kMaxUnevenDepth ? divideByArea(range, axis, centers) : 0;
    if (low == 0) low = divideByNumber(range, axis);
    return {rangeOf(range.first, low), rangeOf(range.first + low, range.count - low)};
  }

  /// How many triangles the lower part has; 0 where all fall into one bin.
  std::uint32_t divideByArea(const Range& range, int axis, const base::Aabb& centers) {
    const float scale = static_cast<float>(kBins) / std::max(centers.size()[axis], 1e-30F);
    const auto binOf = [&](const Triangle& triangle) {
      const float at = (triangle.sum()[axis] - centers.min[axis]) * scale;
      return at < static_cast<float>(kBins) ? static_cast<std::size_t>(std::max(at, 0.0F)) : kBins - 1;
    };
    std::array<base::Aabb, kBins> boxes;
    std::array<std::uint32_t, kBins> counts{};
    for (std::uint32_t t = range.first; t < range.first + range.count; ++t) {
      const std::size_t bin = binOf(triangles_[t]);
      boxes[bin].add(triangles_[t].box());
      ++counts[bin];
    }

    // A part costs its leaves times the share of rays that meet it.
    const auto costOf = [](const base::Aabb& box, std::uint32_t count) {
      return halfArea(box) * static_cast<float>((count + kWidth - 1) / kWidth);
    };
    std::array<float, kBins> cost_above{};
    base::Aabb above;
    std::uint32_t count_above = 0;
    for (std::size_t bin = kBins; bin-- > 1;) {
      above.add(boxes[bin]);
      cost_above[bin] = costOf(above, count_above += counts[bin]);
    }
    base::Aabb below;
    std::uint32_t count_below = 0;
    std::size_t best = 0;
    float least = std::numeric_limits<float>::max();
    for (std::size_t bin = 1; bin < kBins; ++bin) {
      below.add(boxes[bin - 1]);
      count_below += counts[bin - 1];
      const float cost = costOf(below, count_below) + cost_above[bin];
      if (count_below == 0 || count_below == range.count || cost >= least) continue;
      least = cost, best = bin;
    }
    if (best == 0) return 0;
    const auto begin = triangles_.begin() + static_cast<std::ptrdiff_t>(range.first);
    const auto middle = std::partition(begin, begin + static_cast<std::ptrdiff_t>(range.count),
                                       [&](const Triangle& triangle) { return binOf(triangle) < best; });
    return static_cast<std::uint32_t>(middle - begin);
  }

  std::uint32_t divideByNumber(const Range& range, int axis) {
    const std::uint32_t half = range.count / 2;
    const auto begin = triangles_.begin() + static_cast<std::ptrdiff_t>(range.first);
    std::nth_element(begin, begin + half, begin + range.count,
                     [axis](const Triangle& s, const Triangle& t) { return s.sum()[axis] < t.sum()[axis]; });
    return half;
  }

  std::vector<Triangle> triangles_;
  std::vector<Node>& nodes_;
  std::vector<Leaf>& leaves_;
};

base::Result<ProxySight> ProxySight::ofPatches(const Hierarchy& hierarchy, std::span<const std::uint32_t> patches,
                                               float error, const GeometryOf& geometry_of) {
  ProxySight sight;
  sight.error_ = error;
  std::vector<Triangle> triangles;
  for (const std::uint32_t patch : patches) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, geometry_of(patch));
    const auto corner = [&](std::size_t i) {
      return hierarchy.lattice.position(geometry.positions[geometry.indices[i]]);
    };
    for (std::size_t i = 0; i + 2 < geometry.indices.size(); i += 3)
      triangles.push_back({{corner(i), corner(i + 1), corner(i + 2)}});
  }
  for (const Triangle& triangle : triangles) sight.box_.add(triangle.box());
  sight.triangle_count_ = triangles.size();
  Builder(std::move(triangles), sight.nodes_, sight.leaves_).build();
  return sight;
}

base::Result<ProxySight> ProxySight::ofFile(const PatchFile& file, std::uint64_t max_triangles) {
  const UniformCut finest = selectFinestUniformCut(file.hierarchy(), max_triangles);
  return ofPatches(file.hierarchy(), finest.cut.patches, finest.error,
                   [&](std::uint32_t patch) { return file.geometry(patch); });
}

namespace {

/// Boxes are tested in float, with the rounding error added to the far end: one box too many does no harm.
constexpr float kFarEnd = 1.0F + 1e-5F;

/// A ray as it is tested against four boxes.
class RayToBoxes {
 public:
  RayToBoxes(const glm::vec3& origin, const glm::dvec3& direction, double from)
      : from_(fourOf(static_cast<float>(from))) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto d = static_cast<float>(direction[static_cast<int>(axis)]);
      const float inverse = 1.0F / (std::abs(d) > 1e-30F ? d : std::copysign(1e-30F, d));
      start_[axis] = fourOf(origin[static_cast<int>(axis)]);
      inverse_[axis] = fourOf(inverse);
      near_side_[axis] = inverse < 0.0F ? 1 : 0;
    }
  }

  struct Entries {
    Float4 at;             ///< distances at which the ray enters
    std::uint32_t is_met;  ///< a bit a box
  };
  template <class Node>
  LUMIGRID_ALWAYS_INLINE Entries enter(const Node& node, double to) const {
    Float4 in = from_;
    Float4 out = fourOf(static_cast<float>(to));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Float4 p = (node.sides[near_side_[axis]][axis] - start_[axis]) * inverse_[axis];
      const Float4 q = (node.sides[1 - near_side_[axis]][axis] - start_[axis]) * inverse_[axis];
      // NaN, of a place without child, stays.
      in = in > p ? in : p;
      out = out < q ? out : q;
    }
    return {in, base::bitsOf(in <= out * fourOf(kFarEnd))};
  }

 private:
  std::array<Float4, 3> start_, inverse_;
  std::array<std::size_t, 3> near_side_{};
  Float4 from_;
};

}  // namespace

/// A ray with the part of it that is looked at.
struct ProxySight::RayPart {
  RayPart(const glm::vec3& origin, const glm::dvec3& direction, double first, double last)
      : from(first), to(last), sheared(glm::dvec3(origin), direction), boxes(origin, direction, first) {}

  double from, to;  ///< lengths of the direction
  ShearedRay sheared;
  RayToBoxes boxes;
};

// Calls visit(triangle, distance in lengths of the ray's direction) for triangles of a leaf that the ray meets, until
// it returns false; then returns false.
template <class Visit>
bool ProxySight::visitLeaf(const RayPart& ray, std::uint32_t number, const Visit& visit) const {
  const Leaf& leaf = leaves_[number];
  for (std::uint32_t inside = ray.sheared.mayMeet(leaf.corners), place = 0; inside != 0; inside >>= 1, ++place) {
    if ((inside & 1U) == 0) continue;
    const auto met = ray.sheared.meets(glm::dvec3(leaf.corner(0, place)), glm::dvec3(leaf.corner(1, place)),
                                       glm::dvec3(leaf.corner(2, place)));
    if (met && met->distance >= ray.from && met->distance <= ray.to &&
        !visit(TriangleNumber{number, place}, met->distance))
      return false;
  }
  return true;
}

// The same for all leaves, nearer ones first where that is wanted. The ray's end may be drawn in on the way.
template <bool kNearestFirst, class Visit>
void ProxySight::walk(const RayPart& ray, const Visit& visit) const {
  // Distances are not negative, so the bits of their floats are in their order.
  const auto pending = [](float entry, std::uint32_t node) {
    return std::uint64_t{base::bitCast<std::uint32_t>(entry)} << 32 | node;
  };
  const auto entryOf = [](std::uint64_t next) { return base::bitCast<float>(static_cast<std::uint32_t>(next >> 32)); };
  std::array<std::uint64_t, kMaxStack> stack;
  std::size_t depth = 0;
  stack[depth++] = pending(static_cast<float>(ray.from), 0);
  while (depth > 0) {
    const std::uint64_t next = stack[--depth];
    const auto number = static_cast<std::uint32_t>(next);
    if (kNearestFirst && entryOf(next) > static_cast<float>(ray.to) * kFarEnd) continue;
    if ((number & kIsLeaf) != 0) {
      if (!visitLeaf(ray, number & ~kIsLeaf, visit)) return;
      continue;
    }
    // Without branches: which children are met cannot be predicted.
    const Node& node = nodes_[number];
    const auto entries = ray.boxes.enter(node, ray.to);
    const std::size_t before = depth;
    for (std::size_t i = 0; i < kWidth; ++i) {
      stack[depth] = pending(entries.at[i], node.children[i]);
      depth += entries.is_met >> i & 1U;
    }
    if (kNearestFirst && depth > before + 1)
      std::sort(stack.begin() + before, stack.begin() + depth, std::greater<std::uint64_t>());
  }
}

std::optional<ProxySight::Intersection> ProxySight::nearest(const glm::vec3& origin, const glm::vec3& direction,
                                                            float max_distance) const {
  if (nodes_.empty()) return std::nullopt;
  std::optional<TriangleNumber> met;
  RayPart ray(origin, glm::dvec3(direction), 0.0, static_cast<double>(max_distance));
  walk<true>(ray, [&](const TriangleNumber& triangle, double distance) {
    // The first in the tree of equally near ones is taken, so that the order of the walk does not matter.
    const bool is_later = met && std::pair(met->leaf, met->place) < std::pair(triangle.leaf, triangle.place);
    if (distance < ray.to || !is_later) met = triangle;
    ray.to = distance;
    return true;
  });
  if (!met) return std::nullopt;
  const Leaf& leaf = leaves_[met->leaf];
  const glm::dvec3 a(leaf.corner(0, met->place));
  const glm::dvec3 across =
      glm::cross(glm::dvec3(leaf.corner(1, met->place)) - a, glm::dvec3(leaf.corner(2, met->place)) - a);
  return Intersection{static_cast<float>(ray.to), glm::vec3(across / std::max(glm::length(across), 1e-300)), met->leaf};
}

bool ProxySight::isBlocked(const glm::vec3& from, const glm::vec3& to, float clearance) const {
  const glm::dvec3 way = glm::dvec3(to) - glm::dvec3(from);
  const double length = glm::length(way);
  const auto inset = static_cast<double>(clearance);
  if (!(length > 2.0 * inset) || nodes_.empty()) return false;
  bool blocked = false;
  walk<false>(RayPart(from, way / length, inset, length - inset), [&](const TriangleNumber&, double) {
    blocked = true;
    return false;
  });
  return blocked;
}

}  // namespace lod::patch
