#include "lod/pmr/builder/umbrellas.h"

#include <algorithm>
#include <cmath>

#include "lod/pmr/builder/tangent_polygon.h"

namespace lod::pmr::builder {
namespace {

// Nearest points asked for in turn, until the polygon is certain.
constexpr std::array<std::size_t, 3> kNearest{24, 80, 256};

}  // namespace

Umbrellas::Umbrellas(std::span<const glm::dvec3> places, std::span<const std::uint32_t> numbers)
    : places_(places), numbers_(numbers), floats_(places.begin(), places.end()) {
  near_.emplace(floats_);
}

void Umbrellas::find(std::uint32_t i, const glm::vec3& unit_normal, std::vector<Triangle>& out) {
  for (const std::size_t nearest : kNearest) {
    near_->find(floats_[i], nearest + 1, std::numeric_limits<float>::max(), found_);
    if (found_.size() < 3) return;
    const bool all = found_.size() <= nearest;
    // Whatever is not among the nearest is at least this far away, and cuts nothing within half of that.
    const double known = std::sqrt(static_cast<double>(found_.back().distance_squared));
    TangentPolygon polygon(places_[i], glm::dvec3(unit_normal), 2.0 * known);
    for (const auto& one : found_)
      if (one.index != i) polygon.cut(places_[one.index], one.index);
    const double certain = 0.5 * known;
    if (!all && polygon.radius() > certain && nearest != kNearest.back()) continue;
    for (std::uint32_t k = 0; k < polygon.corners(); ++k) {
      const std::uint32_t a = polygon.edgeBefore(k), b = polygon.edge(k);
      if (a == TangentPolygon::kNone || b == TangentPolygon::kNone || a == b) continue;
      if (polygon.distanceSquared(k) > certain * certain) continue;
      Triangle triangle{numbers_[i], numbers_[a], numbers_[b]};
      std::sort(triangle.begin(), triangle.end());
      out.push_back(triangle);
    }
    return;
  }
}

}  // namespace lod::pmr::builder
