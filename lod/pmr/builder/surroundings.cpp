#include "lod/pmr/builder/surroundings.h"

#include <algorithm>
#include <limits>

#include "lod/ingest/nearest_points.h"

namespace lod::pmr::builder {
namespace {

// Nearest points that begin a polygon. A regular one has six neighbours; where so many leave a polygon open, as at a
// rim, the point stays at all levels anyway.
constexpr std::size_t kNearest = 16;
// A polygon that reaches this many times as far as the sixth neighbour is a rim's. A choice.
constexpr double kRimReach = 4.0;
constexpr std::size_t kUsualNeighbours = 6;
// The height limit in distances of the sixth neighbour, which is about 1.4 spacings away. A choice: the coarsest level
// keeps about one in a hundred points of a flat.
constexpr float kLimitReach = 6.0F;
// Nearest points whose normals a rim takes.
constexpr std::size_t kRimNeighbours = 12;
// A square of this many height limits around a point: polygons that reach its edge belong to the rim.
constexpr double kRim = 2.0;

}  // namespace

TangentPolygon polygonOf(const PointBlock& block, std::uint32_t i, const glm::dvec3& normal,
                         std::span<const std::uint32_t> candidates) {
  TangentPolygon polygon(block.places[i], normal, kRim * static_cast<double>(block.height_limits[i]));
  for (const std::uint32_t c : candidates) polygon.cut(block.places[c], c);
  return polygon;
}

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

std::vector<float> heightLimits(std::span<const glm::dvec3> places, const Neighbourhoods& near,
                                std::span<const std::uint32_t> cell, std::vector<float> most) {
  std::vector<float> distances;
  for (std::size_t first = 0, end = 0; first < places.size(); first = end) {
    distances.clear();
    for (end = first; end < places.size() && cell[end] == cell[first]; ++end) {
      const auto around = near.of(static_cast<std::uint32_t>(end));
      if (around.size() < kUsualNeighbours) continue;
      distances.push_back(static_cast<float>(glm::distance(places[end], places[around[kUsualNeighbours - 1]])));
    }
    if (distances.empty()) continue;
    const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
    std::nth_element(distances.begin(), middle, distances.end());
    for (std::size_t i = first; i < end; ++i) most[i] = std::min(most[i], kLimitReach * *middle);
  }
  return most;
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

std::vector<glm::dvec3> umbrellaNormals(const PointBlock& block, const Neighbourhoods& near,
                                        std::span<const VoronoiCell> cells, std::size_t count) {
  std::vector<glm::dvec3> normals(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    normals[i] = cells[i].normal;
    const TangentPolygon polygon = polygonOf(block, i, cells[i].normal, near.of(i));
    glm::dvec3 sum(0.0);
    bool open = false;
    for (std::uint32_t k = 0; k < polygon.corners() && !open; ++k) {
      const std::uint32_t a = polygon.edgeBefore(k), b = polygon.edge(k);
      open = a == TangentPolygon::kNone || b == TangentPolygon::kNone;
      if (!open) sum += glm::cross(block.places[a] - block.places[i], block.places[b] - block.places[i]);
    }
    if (!open && glm::length(sum) > 0.0) normals[i] = glm::normalize(sum);
  }
  return normals;
}

}  // namespace lod::pmr::builder
