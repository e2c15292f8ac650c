#include "repository/sampling/gaps.h"

namespace repository {

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
