#include "lod/pmr/builder/umbrellas.h"

#include <algorithm>
#include <cmath>

namespace lod::pmr::builder {
namespace {

// Nearest points that begin a polygon: most are done with them.
constexpr std::size_t kNearest = 16;
// A corner is at most this many times as far as the last of them.
constexpr double kGap = 2.0;

}  // namespace

void Umbrella::appendTriangles(std::uint32_t center, std::vector<Triangle>& out) const {
  for (std::uint32_t k = 0; k < count; ++k) {
    const std::uint32_t a = around[k == 0 ? count - 1 : k - 1], b = around[k];
    if (a == kNone || b == kNone || a == b) continue;
    out.emplace_back(center, a, b);
  }
}

Umbrellas::Umbrellas(std::span<const glm::dvec3> places, std::span<const std::uint32_t> numbers)
    : places_(places), numbers_(numbers), floats_(places.begin(), places.end()) {
  near_.emplace(floats_);
}

void Umbrellas::find(std::uint32_t i, const glm::vec3& unit_normal, double reach, Umbrella& out) {
  out.count = 0;
  near_->find(floats_[i], kNearest + 1, std::numeric_limits<float>::max(), found_);
  if (found_.size() < 3) return;
  const double known = std::sqrt(static_cast<double>(found_.back().distance_squared));
  TangentPolygon polygon(places_[i], glm::dvec3(unit_normal), std::max(reach, kGap * known));
  for (const auto& one : found_)
    if (one.index != i) polygon.cut(places_[one.index], one.index);
  // Whatever is not among the nearest is at least as far as the last, and cuts nothing within half of that.
  const bool all = found_.size() <= kNearest;
  if (!all && 2.0 * polygon.radius() > known) {
    const auto cut = [&](std::uint32_t other, float squared) {
      if (squared >= found_.back().distance_squared) polygon.cut(places_[other], other);
      return static_cast<float>(4.0 * polygon.radiusSquared());
    };
    near_->visitWithin(floats_[i], static_cast<float>(4.0 * polygon.radiusSquared()), cut);
  }
  for (std::uint32_t k = 0; k < polygon.corners(); ++k) {
    const std::uint32_t other = polygon.edge(k);
    out.around[out.count++] = other == TangentPolygon::kNone ? Umbrella::kNone : numbers_[other];
  }
}

}  // namespace lod::pmr::builder
