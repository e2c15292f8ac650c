#include "repository/sampling/expected_points.h"

#include <algorithm>

namespace repository {

ExpectedPoints::ExpectedPoints(const Grid& grid, const Shard& shard, const SampleTree* tree)
    : grid_(grid), range_(pointsOf(shard, grid)), listed_(tree != nullptr) {
  if (tree == nullptr) return;
  for (const glm::uvec3& point : tree->points())
    if (shard.count == 1 || range_.contains(mortonRank(grid, point))) codes_.push_back(codeOfPoint(point));
}

glm::uvec3 ExpectedPoints::at(std::uint64_t place) const {
  if (!listed_) return pointAtMortonRank(grid_, range_.first + place);
  const FaceKey key = *FaceKey::fromCode(codes_[place]);
  return {key.x, key.y, key.z};
}

std::optional<std::uint64_t> ExpectedPoints::placeOf(const glm::uvec3& point) const {
  if (!listed_) {
    const std::uint64_t rank = mortonRank(grid_, point);
    return range_.contains(rank) ? std::optional(rank - range_.first) : std::nullopt;
  }
  const auto found = std::lower_bound(codes_.begin(), codes_.end(), codeOfPoint(point));
  if (found == codes_.end() || *found != codeOfPoint(point)) return std::nullopt;
  return static_cast<std::uint64_t>(found - codes_.begin());
}

void GapFinder::addPresentKey(const FaceKey& key) {
  const auto place = placeOf(key);
  if (!place || *place < next_) return;
  addGapUpTo(*place);
  next_ = *place + 1;
}

FaceKey GapFinder::keyAt(std::uint64_t place) const {
  const glm::uvec3 point = points_.at(place / 6);
  return {point.x, point.y, point.z, static_cast<std::uint32_t>(place % 6)};
}

// The six faces of a point come one after another, so the point's place is computed once for all of them.
std::optional<std::uint64_t> GapFinder::placeOf(const FaceKey& key) {
  const glm::uvec3 point(key.x, key.y, key.z);
  if (!last_point_ || *last_point_ != point) {
    last_point_ = point;
    last_place_ = points_.placeOf(point);
  }
  return last_place_ ? std::optional(6 * *last_place_ + key.d) : std::nullopt;
}

void GapFinder::addGapUpTo(std::uint64_t place) {
  if (place > next_) gaps_.push_back({keyAt(next_), keyAt(place - 1), place - next_});
  next_ = place;
}

}  // namespace repository
