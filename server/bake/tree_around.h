#pragma once
// A tree of sampling points around points that were chosen.
#include <glm/glm.hpp>
#include <tuple>
#include <vector>

#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace server {

/// The order of points in what is chosen by use.
inline bool comesFirst(const glm::uvec3& a, const glm::uvec3& b) {
  return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
}

/// Cells are split down to single steps around each of these points (sorted by comesFirst()), so that whoever looks
/// there finds it; all other points are left out.
repository::SampleTree treeAround(const repository::Grid& grid, const std::vector<glm::uvec3>& points);

}  // namespace server
