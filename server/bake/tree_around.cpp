#include "server/bake/tree_around.h"

#include <algorithm>
#include <cstdint>
#include <unordered_set>

namespace server {
namespace {

/// The cells of `size` steps that have one of these points within or on a side, by their places among such cells.
std::unordered_set<std::uint64_t> cellsAround(const std::vector<glm::uvec3>& points, std::uint32_t size) {
  std::unordered_set<std::uint64_t> cells;
  for (const glm::uvec3& p : points)
    for (std::uint32_t i = 0; i < 8; ++i) {
      const glm::uvec3 below(std::min(p.x, i & 1), std::min(p.y, i >> 1 & 1), std::min(p.z, i >> 2));
      const glm::uvec3 cell = (p - below) / size;
      cells.insert(repository::codeOfPoint(cell));
    }
  return cells;
}

/// The largest power of two of grid steps that the grid's longest side holds.
std::uint32_t largestCell(const repository::Grid& grid) {
  const std::uint32_t steps = std::max({grid.count.x, grid.count.y, grid.count.z}) - 1;
  std::uint32_t size = 1;
  while (2 * size <= steps) size *= 2;
  return size;
}

}  // namespace

repository::SampleTree treeAround(const repository::Grid& grid, const std::vector<glm::uvec3>& points) {
  repository::SampleTree tree(grid, largestCell(grid));
  for (auto open = tree.openLeaves(); !open.empty(); open = tree.openLeaves()) {
    const std::uint32_t size = open.front().size;  // all have the same: each round splits or closes all
    const auto around = cellsAround(points, size);
    for (const repository::SampleTree::Cell& cell : open) {
      const glm::uvec3 at = cell.corner / size;
      around.count(repository::codeOfPoint(at)) != 0 ? tree.split(cell) : tree.close(cell);
    }
  }
  for (const glm::uvec3& p : tree.points())
    if (!std::binary_search(points.begin(), points.end(), p, comesFirst)) tree.leaveOut(p);
  return tree;
}

}  // namespace server
