#include "lod/pmr/traverse.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "lod/morton.h"
#include "lod/view_box.h"

namespace lod::pmr {
namespace {

constexpr float kSmallestPixel = 1e-30F;

/// A camera with NaN in it has pixels of this size, so that orders stay orders.
float positive(float pixel) {
  return pixel > kSmallestPixel ? pixel : kSmallestPixel;
}

}  // namespace

float pixelSizeAt(const base::Camera& camera, const base::Aabb& box) {
  const float scale = camera.pixelsPerUnitAtOne();
  if (camera.orthographic()) return positive(1.0F / scale);

  // The part of the box that is seen is not nearer, along the view's axis, than its nearest corner or than its nearest
  // point would be at the picture's corner.
  const glm::mat4 clip = camera.clipFromScene();
  float depth = std::numeric_limits<float>::max();
  for (int i = 0; i < 8; ++i) depth = std::min(depth, (clip * glm::vec4(box.corner(i), 1.0F)).w);
  const float distance = glm::length(glm::clamp(camera.eye, box.min, box.max) - camera.eye);
  depth = std::max({depth, distance * cornerCosine(camera), base::nearPlaneOf(camera).value_or(0.0F)});
  return positive(depth / scale);
}

std::uint32_t levelFor(const Leaf& leaf, float pixel, float tolerance) {
  const float finest = leaf.levels[0].radius;
  const float fade = std::clamp(0.5F * (pixel / std::max(finest, kSmallestPixel) - 2.0F), 0.0F, 1.0F);
  const float factor = tolerance > 1.0F ? tolerance + (1.0F - tolerance) * fade : tolerance;
  const float wanted = std::max(factor * pixel, kSmallestPixel);

  std::uint32_t best = 0;
  float least = std::numeric_limits<float>::infinity();
  for (std::uint32_t level = 0; level < kLevels; ++level) {
    const float radius = leaf.levels[level].radius;
    if (!(radius > 0.0F)) continue;
    // Among levels that are equally near, the coarsest has the fewest triangles.
    const float ratio = std::max(radius / wanted, wanted / radius);
    if (ratio <= least) least = ratio, best = level;
  }
  return best;
}

Octree::Octree(std::span<const Leaf> leaves) {
  // The octant of a cell at a depth: three bits of its Morton code.
  const auto octant = [&](std::uint32_t leaf, std::uint32_t depth) {
    return leaves[leaf].code >> 3 * (kPositionBits - 1 - depth) & 7;
  };
  struct Builder {
    std::vector<Node>& nodes;
    std::span<const Leaf> leaves;
    const decltype(octant)& octant_at;

    void add(std::uint32_t first, std::uint32_t end, std::uint32_t depth) {
      // Cells with one child of their own are passed over.
      while (end - first > 1 && depth < kPositionBits && octant_at(first, depth) == octant_at(end - 1, depth)) ++depth;
      const std::size_t node = nodes.size();
      nodes.push_back({{}, first, end, 0});
      if (end - first > 1 && depth < kPositionBits) {
        for (std::uint32_t begin = first, next = first; begin < end; begin = next) {
          while (next < end && octant_at(next, depth) == octant_at(begin, depth)) ++next;
          add(begin, next, depth + 1);
        }
      }
      for (std::uint32_t leaf = first; leaf < end; ++leaf) nodes[node].box.add(leaves[leaf].box);
      nodes[node].skip = static_cast<std::uint32_t>(nodes.size());
    }
  };
  if (!leaves.empty()) Builder{nodes_, leaves, octant}.add(0, static_cast<std::uint32_t>(leaves.size()), 0);
}

void Octree::choose(std::span<const Leaf> leaves, const TraverseRequest& request,
                    std::vector<ChosenLeaf>& result) const {
  result.clear();
  const base::Frustum frustum(request.tile.value_or(request.camera).clipFromScene());
  for (std::uint32_t i = 0; i < nodes_.size();) {
    const Node& node = nodes_[i];
    const bool outside = (request.cull && !frustum.mayOverlap(node.box)) || isBeyond(request.camera.section, node.box);
    if (!outside && node.end - node.first == 1) {
      const Leaf& leaf = leaves[node.first];
      const float pixel = pixelSizeAt(request.camera, leaf.box);
      result.push_back({node.first, levelFor(leaf, pixel, request.tolerance), pixel, leaf.box.diagonal() / pixel});
    }
    i = outside ? node.skip : i + 1;
  }
  std::sort(result.begin(), result.end(), [](const ChosenLeaf& a, const ChosenLeaf& b) {
    return a.priority != b.priority ? a.priority > b.priority : a.leaf < b.leaf;
  });
}

}  // namespace lod::pmr
