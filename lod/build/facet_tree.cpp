#include "lod/build/facet_tree.h"

#include "base/check.h"
#include "base/geometry.h"

namespace lod::build {

FacetTree::FacetTree(std::span<const glm::vec3> positions, std::span<const std::uint32_t> indices) {
  LUMIGRID_CHECK(!indices.empty());
  std::vector<base::Aabb> below(indices.size() / 3);
  for (std::size_t i = 0; i < indices.size(); ++i) below[i / 3].add(positions[indices[i]]);
  boxes_.reserve(below.size() / 3 + kMaxLevels);
  do {
    first_.push_back(boxes_.size());
    std::size_t joined = 0;
    for (std::size_t first = 0; first < below.size(); first += kSiblings) {
      Boxes& boxes = boxes_.emplace_back();
      base::Aabb all;
      for (std::size_t i = 0; i < kSiblings && first + i < below.size(); ++i) {
        const base::Aabb& box = below[first + i];
        const glm::vec3 center = box.center();
        const glm::vec3 half = 0.5F * box.size();
        boxes.center[0][i] = center.x, boxes.center[1][i] = center.y, boxes.center[2][i] = center.z;
        boxes.half[0][i] = half.x, boxes.half[1][i] = half.y, boxes.half[2][i] = half.z;
        all.add(box);
      }
      below[joined++] = all;
    }
    below.resize(joined);
  } while (below.size() > 1);
}

}  // namespace lod::build
