#include "lod/build/facet_tree.h"

namespace lod::build {

FacetTree::FacetTree(std::span<const glm::vec3> positions, std::span<const std::uint32_t> indices) {
  struct Box {
    glm::vec3 low{std::numeric_limits<float>::infinity()};
    glm::vec3 high{-std::numeric_limits<float>::infinity()};
  };
  std::vector<Box> below(indices.size() / 3);
  for (std::size_t t = 0; t < below.size(); ++t) {
    const glm::vec3& a = positions[indices[3 * t]];
    const glm::vec3& b = positions[indices[3 * t + 1]];
    const glm::vec3& c = positions[indices[3 * t + 2]];
    below[t] = {glm::min(glm::min(a, b), c), glm::max(glm::max(a, b), c)};
  }
  boxes_.reserve(below.size() / 3 + kMaxLevels);
  do {
    first_.push_back(boxes_.size());
    std::size_t joined = 0;
    for (std::size_t first = 0; first < below.size(); first += kSiblings) {
      Boxes& boxes = boxes_.emplace_back();
      Box all;
      for (std::size_t i = 0; i < kSiblings && first + i < below.size(); ++i) {
        const Box& box = below[first + i];
        for (std::size_t k = 0; k < 3; ++k) {
          const auto axis = static_cast<glm::length_t>(k);
          boxes.center[k][i] = 0.5F * (box.low[axis] + box.high[axis]);
          boxes.half[k][i] = 0.5F * (box.high[axis] - box.low[axis]);
        }
        all.low = glm::min(all.low, box.low), all.high = glm::max(all.high, box.high);
      }
      below[joined++] = all;
    }
    below.resize(joined);
  } while (below.size() > 1);
}

}  // namespace lod::build
