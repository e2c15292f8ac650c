#include "lod/pmr/builder/decimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <tuple>

#include "lod/pmr/format.h"

namespace lod::pmr::builder {
namespace {

class Decimation {
 public:
  Decimation(const PointBlock& block, std::span<const VoronoiCell> cells)
      : block_(block), cells_(cells), points_(block.places.size()), classes_(block.own, kCoarsest) {}

  std::vector<std::uint8_t> run(const Neighbourhoods& near) {
    for (std::uint32_t i = 0; i < points_.size(); ++i) setPolygon(i, near.of(i));
    for (std::uint32_t level = 1; level < kLevels; ++level) decimateTo(level);
    return std::move(classes_);
  }

 private:
  struct Point {
    float ratio = 0.0F;
    bool alive = true;
    std::uint8_t neighbours = 0;
    std::array<std::uint32_t, TangentPolygon::kMaxCorners> neighbour;

    std::span<const std::uint32_t> around() const { return std::span(neighbour).first(neighbours); }
  };

  void setPolygon(std::uint32_t i, std::span<const std::uint32_t> candidates) {
    Point& point = points_[i];
    const TangentPolygon polygon = polygonOf(block_, i, cells_[i].normal, candidates);
    point.neighbours = 0;
    for (std::uint32_t k = 0; k < polygon.corners(); ++k)
      if (polygon.edge(k) != TangentPolygon::kNone) point.neighbour[point.neighbours++] = polygon.edge(k);
    const auto limit = static_cast<double>(block_.height_limits[i]);
    const double height = std::min(cells_[i].height, limit);
    point.ratio = height > 0.0 ? static_cast<float>(polygon.radius() / std::sqrt(height * limit))
                               : std::numeric_limits<float>::max();
  }

  // The order of deletion must not depend on the block, so equal ratios go by place.
  struct Entry {
    float ratio = 0.0F;
    std::uint32_t point = 0;
  };
  bool comesLater(const Entry& a, const Entry& b) const {
    if (a.ratio != b.ratio) return a.ratio > b.ratio;
    const glm::dvec3 &p = block_.places[a.point], &q = block_.places[b.point];
    return std::tie(p.x, p.y, p.z) > std::tie(q.x, q.y, q.z);
  }

  void decimateTo(std::uint32_t level) {
    const float threshold = thresholdOf(level);
    std::vector<Entry> first;
    for (std::uint32_t i = 0; i < points_.size(); ++i)
      if (points_[i].alive && points_[i].ratio < threshold) first.push_back({points_[i].ratio, i});
    const auto later = [this](const Entry& a, const Entry& b) { return comesLater(a, b); };
    std::priority_queue<Entry, std::vector<Entry>, decltype(later)> queue(later, std::move(first));
    while (!queue.empty()) {
      const Entry entry = queue.top();
      queue.pop();
      const std::uint32_t i = entry.point;
      if (!points_[i].alive || points_[i].ratio != entry.ratio) continue;
      remove(i, level);
      for (const std::uint32_t n : points_[i].around())
        if (points_[n].alive && points_[n].ratio < threshold) queue.push({points_[n].ratio, n});
    }
  }

  void remove(std::uint32_t i, std::uint32_t level) {
    points_[i].alive = false;
    if (i < block_.own) classes_[i] = static_cast<std::uint8_t>(level - 1);
    const Point removed = points_[i];
    for (const std::uint32_t n : removed.around()) {
      if (!points_[n].alive) continue;
      candidates_.clear();
      for (const std::span<const std::uint32_t> list : {points_[n].around(), removed.around()})
        for (const std::uint32_t c : list)
          if (c != n && points_[c].alive) candidates_.push_back({squaredDistance(n, c), c});
      std::sort(candidates_.begin(), candidates_.end());
      candidates_.erase(std::unique(candidates_.begin(), candidates_.end()), candidates_.end());
      order_.clear();
      for (const auto& [squared, c] : candidates_) order_.push_back(c);
      setPolygon(n, order_);
    }
  }

  double squaredDistance(std::uint32_t a, std::uint32_t b) const {
    const glm::dvec3 d = block_.places[a] - block_.places[b];
    return glm::dot(d, d);
  }

  const PointBlock& block_;
  std::span<const VoronoiCell> cells_;
  std::vector<Point> points_;
  std::vector<std::uint8_t> classes_;
  std::vector<std::pair<double, std::uint32_t>> candidates_;
  std::vector<std::uint32_t> order_;
};

}  // namespace

std::vector<std::uint8_t> decimate(const PointBlock& block, const Neighbourhoods& near,
                                   std::span<const VoronoiCell> cells) {
  return Decimation(block, cells).run(near);
}

}  // namespace lod::pmr::builder
