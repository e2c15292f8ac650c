#pragma once
// The points of which a store should hold images, counted in Morton order.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/shard.h"

namespace repository {

/// All points of a shard, without a list of them; or of these the ones that a tree samples, listed.
class ExpectedPoints {
 public:
  /// `tree`: null where all points of the grid are sampled; not kept.
  ExpectedPoints(const Grid& grid, const Shard& shard, const SampleTree* tree);
  std::uint64_t size() const { return listed_ ? codes_.size() : range_.size(); }
  /// The point at `place`, below size().
  glm::uvec3 at(std::uint64_t place) const;
  /// The inverse; nothing for a point of the grid that is not among them.
  std::optional<std::uint64_t> placeOf(const glm::uvec3& point) const;

 private:
  Grid grid_;
  PointRange range_;
  bool listed_ = false;
  std::vector<std::uint64_t> codes_;  // of each point's first key, ascending; only when listed
};

}  // namespace repository
