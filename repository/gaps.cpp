#include "repository/gaps.h"

namespace repository {

GapFinder::GapFinder(const Grid& grid, const Shard& shard)
    : grid_(grid), next_(6 * pointsOf(shard, grid).first), end_(6 * pointsOf(shard, grid).end) {}

void GapFinder::take(const FaceKey& key) {
  const std::uint64_t place = placeOf(key);
  if (place < next_ || place >= end_) return;
  missUpTo(place);
  next_ = place + 1;
}

void GapFinder::finish() {
  missUpTo(end_);
}

FaceKey GapFinder::keyAt(std::uint64_t place) const {
  const glm::uvec3 point = pointAtMortonRank(grid_, place / 6);
  return {point.x, point.y, point.z, static_cast<std::uint32_t>(place % 6)};
}

// Faces of a point follow each other: the rank is worked out once for them.
std::uint64_t GapFinder::placeOf(const FaceKey& key) {
  const glm::uvec3 point(key.x, key.y, key.z);
  if (!last_point_ || *last_point_ != point) {
    last_point_ = point;
    last_rank_ = mortonRank(grid_, point);
  }
  return 6 * last_rank_ + key.d;
}

void GapFinder::missUpTo(std::uint64_t place) {
  if (place > next_) gaps_.push_back({keyAt(next_), keyAt(place - 1), place - next_});
  next_ = place;
}

}  // namespace repository
