#include "lod/build/facet_tree.h"

#include <algorithm>
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

  // By the cell of a corner: a fine order would cost more than it saves.
  constexpr unsigned kCellBits = 5;
  std::uint32_t highest = 1;
  for (const glm::vec3& p : positions) highest |= static_cast<std::uint32_t>(std::max({p.x, p.y, p.z}));
  const auto bits = static_cast<unsigned>(std::bit_width(highest));
  const int shift = bits > kCellBits ? static_cast<int>(bits - kCellBits) : 0;
  std::vector<KeyedIndex> sorted(triangles);
  for (std::uint32_t t = 0; t < triangles; ++t)
    sorted[t] = {mortonCode(glm::ivec3(positions[indices[3 * std::size_t{t}]]) >> shift), t};
  radixSort(sorted, 3 * kCellBits);
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
