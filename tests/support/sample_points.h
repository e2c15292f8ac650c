#pragma once
// Asks a tree of sampling points for one point, independently of SampleTree::points().
#include <algorithm>

#include "repository/sampling/sample_tree.h"

namespace support {

/// Whether the point is sampled: it is a corner of a leaf and not left out.
inline bool hasPoint(const repository::SampleTree& tree, const repository::Grid& grid, const glm::uvec3& point) {
  if (glm::any(glm::greaterThanEqual(point, grid.count)) || tree.leavesOut(point)) return false;
  // The point is sampled if it is a corner of the leaf that holds one of the grid cells around it.
  for (std::uint32_t i = 0; i < 8; ++i) {
    const glm::uvec3 low(i & 1U, i >> 1 & 1U, i >> 2);
    if (glm::any(glm::lessThan(point, low))) continue;
    const glm::uvec3 cell = point - low;
    if (glm::any(glm::greaterThanEqual(cell + 1U, grid.count))) continue;
    const auto corners = tree.cornersOf(tree.leafOf(cell));
    if (std::find(corners.begin(), corners.end(), point) != corners.end()) return true;
  }
  return false;
}

}  // namespace support
