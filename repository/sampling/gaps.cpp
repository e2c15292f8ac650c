#include "repository/sampling/gaps.h"

namespace repository {

void GapFinder::take(const FaceKey& key) {
  const auto place = placeOf(key);
  if (!place || *place < next_) return;
  missUpTo(*place);
  next_ = *place + 1;
}

FaceKey GapFinder::keyAt(std::uint64_t place) const {
  const glm::uvec3 point = points_.at(place / 6);
  return {point.x, point.y, point.z, static_cast<std::uint32_t>(place % 6)};
}

// Faces of a point follow each other: the place is worked out once for them.
std::optional<std::uint64_t> GapFinder::placeOf(const FaceKey& key) {
  const glm::uvec3 point(key.x, key.y, key.z);
  if (!last_point_ || *last_point_ != point) {
    last_point_ = point;
    last_place_ = points_.placeOf(point);
  }
  return last_place_ ? std::optional(6 * *last_place_ + key.d) : std::nullopt;
}

void GapFinder::missUpTo(std::uint64_t place) {
  if (place > next_) gaps_.push_back({keyAt(next_), keyAt(place - 1), place - next_});
  next_ = place;
}

}  // namespace repository
