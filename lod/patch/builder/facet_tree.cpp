#include "lod/patch/builder/facet_tree.h"

#include "base/check.h"

namespace lod::patch::builder {

void FacetTree::build(std::span<const glm::vec3> positions, std::span<const std::uint32_t> indices) {
  LUMIGRID_CHECK(!indices.empty());
  boxes_.clear(), first_.clear();
  below_.resize(indices.size() / 3);
  for (std::size_t t = 0; t < below_.size(); ++t) {
    const glm::vec3& a = positions[indices[3 * t]];
    const glm::vec3& b = positions[indices[3 * t + 1]];
    const glm::vec3& c = positions[indices[3 * t + 2]];
    below_[t] = {glm::min(glm::min(a, b), c), glm::max(glm::max(a, b), c)};
  }
  boxes_.reserve(below_.size() / 3 + kMaxLevels);
  do {
    first_.push_back(boxes_.size());
    std::size_t joined = 0;
    for (std::size_t first = 0; first < below_.size(); first += kSiblings) {
      Boxes& boxes = boxes_.emplace_back();
      base::Aabb all = below_[first];
      for (std::size_t i = 0; i < kSiblings && first + i < below_.size(); ++i) {
        const base::Aabb& box = below_[first + i];
        const glm::vec3 center = box.center();
        const glm::vec3 half = 0.5F * box.size();
        boxes.center[0][i] = center.x, boxes.center[1][i] = center.y, boxes.center[2][i] = center.z;
        boxes.half[0][i] = half.x, boxes.half[1][i] = half.y, boxes.half[2][i] = half.z;
        all.add(box);
      }
      below_[joined++] = all;
    }
    below_.resize(joined);
  } while (below_.size() > 1);
}

}  // namespace lod::patch::builder
