#include "lod/build/facet_tree.h"

#include <bit>

#include "lod/build/voxels.h"

namespace lod::build {

FacetTree::FacetTree(std::span<const glm::vec3> positions, std::span<const std::uint32_t> indices) {
  const std::size_t triangles = indices.size() / 3;
  const auto boxOf = [&](std::size_t t) {
    Box box;
    for (std::size_t k = 0; k < 3; ++k) {
      const glm::vec3& p = positions[indices[3 * t + k]];
      box.low = glm::min(box.low, p), box.high = glm::max(box.high, p);
    }
    return box;
  };

  std::vector<KeyedIndex> sorted(triangles);
  std::uint32_t highest = 1;
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const Box box = boxOf(t);
    const glm::ivec3 center(0.5F * (box.low + box.high));
    highest |= static_cast<std::uint32_t>(center.x | center.y | center.z);
    sorted[t] = {mortonCode(center), t};
  }
  radixSort(sorted, 3 * static_cast<std::uint32_t>(std::bit_width(highest)));
  order_.reserve(triangles);
  for (const KeyedIndex& item : sorted) order_.push_back(item.index);

  leaves_ = std::bit_ceil(static_cast<std::uint32_t>((triangles + kLeaf - 1) / kLeaf));
  boxes_.resize(2 * std::size_t{leaves_});
  const auto grow = [](Box& box, const Box& by) {
    box.low = glm::min(box.low, by.low), box.high = glm::max(box.high, by.high);
  };
  for (std::size_t i = 0; i < triangles; ++i) grow(boxes_[leaves_ + i / kLeaf], boxOf(order_[i]));
  for (std::size_t n = leaves_ - 1; n > 0; --n) boxes_[n] = boxes_[2 * n], grow(boxes_[n], boxes_[2 * n + 1]);
}

}  // namespace lod::build
