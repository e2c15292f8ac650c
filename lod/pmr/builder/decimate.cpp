#include "lod/pmr/builder/decimate.h"

#include <algorithm>
#include <array>
#include <queue>
#include <tuple>

#include "lod/ingest/nearest_points.h"
#include "lod/pmr/builder/tangent_polygon.h"
#include "lod/pmr/format.h"

namespace lod::pmr::builder {
namespace {

// Nearest points that begin a polygon. A regular one has six neighbours; where so many leave a polygon open, as at a
// rim, the point stays at all levels anyway.
constexpr std::size_t kNearest = 20;
// A polygon that reaches this many times as far as the sixth neighbour is a rim's. A choice.
constexpr double kRimReach = 4.0;
constexpr std::size_t kUsualNeighbours = 6;
// Nearest points whose normals a rim takes.
constexpr std::size_t kRimNeighbours = 12;
// A square of this many height limits around a point: polygons that reach its edge belong to the rim.
constexpr double kRim = 2.0;

TangentPolygon polygonOf(const PointBlock& block, std::uint32_t i, const glm::dvec3& normal,
                         std::span<const std::uint32_t> candidates) {
  TangentPolygon polygon(block.places[i], normal, kRim * static_cast<double>(block.height_limits[i]));
  for (const std::uint32_t c : candidates) polygon.cut(block.places[c], c);
  return polygon;
}

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

  // `candidates`: nearest first, so that the polygon is small soon.
  void setPolygon(std::uint32_t i, std::span<const std::uint32_t> candidates) {
    Point& point = points_[i];
    const double limit = block_.height_limits[i];
    const TangentPolygon polygon = polygonOf(block_, i, cells_[i].normal, candidates);
    point.neighbours = 0;
    for (std::uint32_t k = 0; k < polygon.corners(); ++k)
      if (polygon.edge(k) != TangentPolygon::kNone) point.neighbour[point.neighbours++] = polygon.edge(k);
    const double height = std::min(cells_[i].height, limit);
    point.ratio = height > 0.0 ? static_cast<float>(polygon.radius() / height) : std::numeric_limits<float>::max();
  }

  // The order of deletion must not depend on the block, so equal ratios go by place.
  using Entry = std::tuple<float, double, double, double, std::uint32_t>;
  Entry entryOf(std::uint32_t i) const {
    const glm::dvec3& p = block_.places[i];
    return {points_[i].ratio, p.x, p.y, p.z, i};
  }

  void decimateTo(std::uint32_t level) {
    const float threshold = thresholdOf(level);
    std::vector<Entry> first;
    for (std::uint32_t i = 0; i < points_.size(); ++i)
      if (points_[i].alive && points_[i].ratio < threshold) first.push_back(entryOf(i));
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue(std::greater<>(), std::move(first));
    while (!queue.empty()) {
      const Entry entry = queue.top();
      queue.pop();
      const std::uint32_t i = std::get<4>(entry);
      if (!points_[i].alive || points_[i].ratio != std::get<0>(entry)) continue;
      remove(i, level);
      for (const std::uint32_t n : points_[i].around())
        if (points_[n].alive && points_[n].ratio < threshold) queue.push(entryOf(n));
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

Neighbourhoods::Neighbourhoods(std::span<const glm::dvec3> places)
    : each_(std::min(kNearest, places.empty() ? 0 : places.size() - 1)) {
  const std::vector<glm::vec3> floats(places.begin(), places.end());
  const ingest::NearestPoints near(floats);
  std::vector<ingest::NearestPoints::Neighbour> found;
  found_.reserve(places.size() * each_);
  for (std::uint32_t i = 0; i < places.size(); ++i) {
    near.find(floats[i], each_ + 1, std::numeric_limits<float>::max(), found);
    std::size_t added = 0;
    for (const auto& one : found)
      if (one.index != i && added < each_) found_.push_back(one.index), ++added;
  }
}

void mendRims(const PointBlock& block, const Neighbourhoods& near, std::span<VoronoiCell> cells) {
  std::vector<bool> at_rim(cells.size(), false);
  for (std::uint32_t i = 0; i < cells.size(); ++i) {
    const auto around = near.of(i);
    if (around.size() < kUsualNeighbours) continue;
    const double usual = glm::distance(block.places[i], block.places[around[kUsualNeighbours - 1]]);
    at_rim[i] = polygonOf(block, i, cells[i].normal, around).radius() > kRimReach * usual;
  }
  for (std::uint32_t i = 0; i < cells.size(); ++i) {
    if (!at_rim[i]) continue;
    glm::dvec3 sum(0.0);
    const auto around = near.of(i);
    for (const std::uint32_t n : around.first(std::min(around.size(), kRimNeighbours)))
      if (!at_rim[n]) sum += glm::dot(sum, cells[n].normal) < 0.0 ? -cells[n].normal : cells[n].normal;
    if (glm::length(sum) > 0.0) cells[i].normal = glm::normalize(sum);
  }
}

std::vector<std::uint8_t> decimate(const PointBlock& block, const Neighbourhoods& near,
                                   std::span<const VoronoiCell> cells) {
  return Decimation(block, cells).run(near);
}

}  // namespace lod::pmr::builder
