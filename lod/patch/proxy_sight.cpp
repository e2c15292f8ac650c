#include "lod/patch/proxy_sight.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "lod/patch/ray_triangle.h"
#include "lod/patch/traverse.h"

namespace lod::patch {
namespace {

// Triangles in a leaf of the tree. A choice: fewer make more boxes to store and to test, more make more triangles to
// test along each ray.
constexpr std::uint32_t kLeafTriangles = 4;
constexpr std::size_t kMaxLevels = 40;  // at most 2^32 triangles are halved 32 times, and the walk keeps one node more

}  // namespace

base::Result<ProxySight> ProxySight::ofPatches(const Hierarchy& hierarchy, std::span<const std::uint32_t> patches,
                                               float error, const GeometryOf& geometry_of) {
  ProxySight sight;
  sight.error_ = error;
  for (const std::uint32_t patch : patches) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, geometry_of(patch));
    const auto corner = [&](std::size_t i) {
      return hierarchy.lattice.position(geometry.positions[geometry.indices[i]]);
    };
    for (std::size_t i = 0; i + 2 < geometry.indices.size(); i += 3)
      sight.triangles_.push_back({corner(i), corner(i + 1), corner(i + 2)});
  }
  if (!sight.triangles_.empty()) sight.build(0, static_cast<std::uint32_t>(sight.triangles_.size()));
  return sight;
}

base::Result<ProxySight> ProxySight::ofFile(const PatchFile& file, std::uint64_t max_triangles) {
  const UniformCut finest = selectFinestUniformCut(file.hierarchy(), max_triangles);
  return ofPatches(file.hierarchy(), finest.cut.patches, finest.error,
                   [&](std::uint32_t patch) { return file.geometry(patch); });
}

// Divides by number along the longest side, so the depth is bounded whatever the triangles are.
void ProxySight::build(std::uint32_t first, std::uint32_t count) {
  const std::size_t index = nodes_.size();
  nodes_.emplace_back();
  base::Aabb box, centers;
  for (std::uint32_t t = first; t < first + count; ++t) {
    const Triangle& triangle = triangles_[t];
    box.add(triangle.a), box.add(triangle.b), box.add(triangle.c);
    centers.add(triangle.a + triangle.b + triangle.c);
  }
  nodes_[index].box = box;
  nodes_[index].first = first;
  nodes_[index].count = count;
  if (count <= kLeafTriangles) return;

  const glm::vec3 size = centers.size();
  const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  const std::uint32_t half = count / 2;
  const auto begin = triangles_.begin() + static_cast<std::ptrdiff_t>(first);
  std::nth_element(begin, begin + half, begin + count, [axis](const Triangle& s, const Triangle& t) {
    return s.a[axis] + s.b[axis] + s.c[axis] < t.a[axis] + t.b[axis] + t.c[axis];
  });
  build(first, half);
  nodes_[index].first = static_cast<std::uint32_t>(nodes_.size());
  nodes_[index].count = 0;
  build(first + half, count - half);
}

// Calls visit(triangle, distance in lengths of `direction`) for triangles met between `from` and `to`, nearer nodes
// first, until it returns false; `to` may shrink on the way.
template <class Visit>
void ProxySight::walk(const glm::dvec3& origin, const glm::dvec3& direction, double from, double& to,
                      const Visit& visit) const {
  if (nodes_.empty()) return;
  const ShearedRay ray(origin, direction);
  // Boxes are tested in float, with the rounding error added to the far end: one box too many does no harm.
  const glm::vec3 start(origin);
  glm::vec3 inverse;
  for (int k = 0; k < 3; ++k) {
    const float d = static_cast<float>(direction[k]);
    inverse[k] = 1.0F / (std::abs(d) > 1e-30F ? d : std::copysign(1e-30F, d));
  }
  const auto entryOf = [&](const base::Aabb& box) {
    const glm::vec3 p = (box.min - start) * inverse;
    const glm::vec3 q = (box.max - start) * inverse;
    const glm::vec3 low = glm::min(p, q);
    const glm::vec3 high = glm::max(p, q);
    const float enter = std::max({low.x, low.y, low.z, static_cast<float>(from)});
    const float leave = std::min({high.x, high.y, high.z, static_cast<float>(to)});
    return enter <= leave + 1e-5F * std::abs(leave) ? enter : std::numeric_limits<float>::infinity();
  };

  struct PendingNode {
    std::uint32_t node;
    float entry;
  };
  std::array<PendingNode, kMaxLevels> stack;
  std::size_t depth = 0;
  const float root = entryOf(nodes_[0].box);
  if (std::isfinite(root)) stack[depth++] = {0, root};
  while (depth > 0) {
    const PendingNode next = stack[--depth];
    if (static_cast<double>(next.entry) > to * (1.0 + 1e-5)) continue;
    const Node& node = nodes_[next.node];
    for (std::uint32_t t = node.first; t < node.first + node.count; ++t) {
      const Triangle& triangle = triangles_[t];
      const auto met = ray.meets(glm::dvec3(triangle.a), glm::dvec3(triangle.b), glm::dvec3(triangle.c));
      if (met && met->distance >= from && met->distance <= to && !visit(triangle, met->distance)) return;
    }
    if (node.count != 0) continue;
    PendingNode near{next.node + 1, entryOf(nodes_[next.node + 1].box)};
    PendingNode far{node.first, entryOf(nodes_[node.first].box)};
    if (far.entry < near.entry) std::swap(near, far);
    if (std::isfinite(far.entry)) stack[depth++] = far;
    if (std::isfinite(near.entry)) stack[depth++] = near;
  }
}

std::optional<ProxySight::Intersection> ProxySight::nearest(const glm::vec3& origin, const glm::vec3& direction,
                                                            float max_distance) const {
  const Triangle* met = nullptr;
  double to = static_cast<double>(max_distance);
  walk(glm::dvec3(origin), glm::dvec3(direction), 0.0, to, [&](const Triangle& triangle, double distance) {
    met = &triangle;
    to = distance;
    return true;
  });
  if (met == nullptr) return std::nullopt;
  const glm::dvec3 a(met->a);
  const glm::dvec3 across = glm::cross(glm::dvec3(met->b) - a, glm::dvec3(met->c) - a);
  return Intersection{static_cast<float>(to), glm::vec3(across / std::max(glm::length(across), 1e-300))};
}

bool ProxySight::isBlocked(const glm::vec3& from, const glm::vec3& to, float clearance) const {
  const glm::dvec3 way = glm::dvec3(to) - glm::dvec3(from);
  const double length = glm::length(way);
  const double inset = static_cast<double>(clearance);
  if (!(length > 2.0 * inset)) return false;
  bool blocked = false;
  double end = length - inset;
  walk(glm::dvec3(from), way / length, inset, end, [&](const Triangle&, double) {
    blocked = true;
    return false;
  });
  return blocked;
}

}  // namespace lod::patch
