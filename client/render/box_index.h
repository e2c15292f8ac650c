#pragma once
// Finds which of many boxes a frustum may overlap. Narrow frusta, as tiles of a face have, reach only a few of them.
#include <cstdint>
#include <span>
#include <vector>

#include "base/geometry.h"

namespace client {

class BoxIndex {
 public:
  explicit BoxIndex(std::span<const base::Aabb> boxes);
  std::size_t size() const { return boxes_.size(); }

  /// Sets `found` to the numbers of the boxes that base::Frustum::mayOverlap() is true for, ascending.
  void findOverlapping(const base::Frustum& frustum, std::vector<std::uint32_t>& found) const;

 private:
  std::vector<std::uint32_t> order_;   // numbers of the boxes, neighbours in space side by side
  std::vector<base::Aabb> boxes_;      // in that order
  std::vector<base::Aabb> clustered_;  // around kCluster of them each
};

}  // namespace client
