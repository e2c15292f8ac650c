#include "client/render/box_index.h"

#include <algorithm>
#include <numeric>

namespace client {
namespace {

/// Boxes tested together first. A choice: about the square root of as many as a close view has.
constexpr std::size_t kCluster = 16;
constexpr float kCodesPerAxis = 1024.0F;

/// Returns the ten lowest bits of x with two zeros between each and the next.
std::uint32_t spread(std::uint32_t x) {
  x = (x | x << 16) & 0x030000FFU;
  x = (x | x << 8) & 0x0300F00FU;
  x = (x | x << 4) & 0x030C30C3U;
  return (x | x << 2) & 0x09249249U;
}

/// Returns the Morton code of each box's middle.
std::vector<std::uint32_t> mortonCodes(std::span<const base::Aabb> boxes) {
  base::Aabb all;
  for (const base::Aabb& box : boxes) all.add(box.center());
  const glm::vec3 scale = (kCodesPerAxis - 1.0F) / glm::max(all.max - all.min, glm::vec3(1e-20F));
  std::vector<std::uint32_t> codes;
  codes.reserve(boxes.size());
  for (const base::Aabb& box : boxes) {
    const glm::uvec3 place(glm::clamp((box.center() - all.min) * scale, glm::vec3(0.0F), glm::vec3(kCodesPerAxis - 1)));
    codes.push_back(spread(place.x) | spread(place.y) << 1 | spread(place.z) << 2);
  }
  return codes;
}

}  // namespace

BoxIndex::BoxIndex(std::span<const base::Aabb> boxes) : order_(boxes.size()) {
  const std::vector<std::uint32_t> codes = mortonCodes(boxes);
  std::iota(order_.begin(), order_.end(), 0U);
  std::sort(order_.begin(), order_.end(), [&](std::uint32_t a, std::uint32_t b) { return codes[a] < codes[b]; });
  boxes_.reserve(boxes.size());
  for (const std::uint32_t number : order_) {
    if (boxes_.size() % kCluster == 0) clustered_.emplace_back();
    boxes_.push_back(boxes[number]);
    clustered_.back().add(boxes[number]);
  }
}

void BoxIndex::findOverlapping(const base::Frustum& frustum, std::vector<std::uint32_t>& found) const {
  found.clear();
  for (std::size_t c = 0; c < clustered_.size(); ++c) {
    if (!frustum.mayOverlap(clustered_[c])) continue;
    for (std::size_t i = c * kCluster; i < std::min((c + 1) * kCluster, boxes_.size()); ++i)
      if (frustum.mayOverlap(boxes_[i])) found.push_back(order_[i]);
  }
  std::sort(found.begin(), found.end());
}

}  // namespace client
