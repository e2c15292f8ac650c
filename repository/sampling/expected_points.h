#pragma once
// The points whose images a store should hold, numbered in Morton order.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/shard.h"

namespace repository {

/// Without a tree this stands for all points of a shard and stores no list; with a tree it lists the shard's sampled
/// points.
class ExpectedPoints {
 public:
  /// `tree` is null where every point of the grid is sampled; the object keeps no reference to it.
  ExpectedPoints(const Grid& grid, const Shard& shard, const SampleTree* tree);
  std::uint64_t size() const { return listed_ ? codes_.size() : range_.size(); }
  /// The point at `place`, below size().
  glm::uvec3 at(std::uint64_t place) const;
  /// The inverse of at(); nothing for a point of the grid that is not expected.
  std::optional<std::uint64_t> placeOf(const glm::uvec3& point) const;

 private:
  Grid grid_;
  PointRange range_;
  bool listed_ = false;
  std::vector<std::uint64_t> codes_;  // codes of the points' first keys, ascending; used only when listed_
};

}  // namespace repository
