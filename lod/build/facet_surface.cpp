#include "lod/build/facet_surface.h"

#include <cmath>

#include "base/geometry.h"

namespace lod::build {
namespace {

constexpr float kEpsilon = std::numeric_limits<float>::epsilon();
// Facets thinner than this share of their length are measured by their edges: their walls say little.
constexpr double kThin = 2.4e-3;

}  // namespace

void FacetSurface::reset(const SurfaceView& surface) {
  surface_ = surface;
  const std::size_t triangles = surface.indices.size() / 3;
  made_.assign(triangles, 0);
  if (facets_.size() < triangles) facets_.resize(triangles);
  grid_.reset();
  makeFans();
  makeEdges();
}

void FacetSurface::make(std::uint32_t t, Facet& f) {
  made_[t] = 1;
  for (std::size_t k = 0; k < 3; ++k) f.corner[k] = surface_.positions[corner(t, k)];
  const glm::vec3 edge[3] = {f.corner[1] - f.corner[0], f.corner[2] - f.corner[1], f.corner[0] - f.corner[2]};
  // In double, where products of lattice vectors are exact: a sliver's plane is as good as any.
  const glm::dvec3 n = glm::cross(glm::dvec3(edge[0]), glm::dvec3(edge[1]));
  const double area = std::sqrt(glm::dot(n, n));
  const float length2[3] = {glm::dot(edge[0], edge[0]), glm::dot(edge[1], edge[1]), glm::dot(edge[2], edge[2])};
  const float longest2 = std::max({length2[0], length2[1], length2[2]});
  f.longest = std::sqrt(longest2);
  f.flat = !(area > 0.0);
  f.thin = !(area > kThin * static_cast<double>(longest2));
  f.roughness = kEpsilon * 64.0F;
  if (f.flat) return;
  if (!f.thin) f.roughness += kEpsilon * 8.0F * longest2 / static_cast<float>(area);
  f.normal = glm::vec3(n * (1.0 / area));
  for (std::size_t k = 0; k < 3; ++k) f.wall[k] = glm::cross(f.normal, edge[k]) * (1.0F / std::sqrt(length2[k]));
}

glm::vec3 FacetSurface::colorNear(std::uint32_t t, const glm::vec3& p) const {
  if (surface_.colors.empty()) return glm::vec3(0.0F);
  const auto at = [&](std::size_t k) { return glm::dvec3(surface_.positions[corner(t, k)]); };
  const glm::vec3 weight(base::closestWeightsOnTriangle(glm::dvec3(p), at(0), at(1), at(2)));
  return weight.x * surface_.colors[corner(t, 0)] + weight.y * surface_.colors[corner(t, 1)] +
         weight.z * surface_.colors[corner(t, 2)];
}

void FacetSurface::makeFans() {
  fan_.assign(surface_.positions.size() + 1, 0);
  for (const std::uint32_t v : surface_.indices) ++fan_[v + 1];
  for (std::size_t v = 1; v < fan_.size(); ++v) fan_[v] += fan_[v - 1];
  around_.resize(surface_.indices.size());
  std::vector<std::uint32_t>& next = scratch_[0];
  next.assign(fan_.begin(), fan_.end() - 1);
  for (std::uint32_t t = 0; t < triangleCount(); ++t)
    for (std::size_t k = 0; k < 3; ++k) around_[next[corner(t, k)]++] = t;
}

void FacetSurface::makeEdges() {
  const std::size_t vertices = surface_.positions.size();
  edges_.clear();
  edge_of_.resize(surface_.indices.size());
  leaving_.assign(vertices, kNone);
  // Of vertex a at hand: which edge leads to b.
  std::vector<std::uint32_t>& seen_from = scratch_[0];
  std::vector<std::uint32_t>& number = scratch_[1];
  seen_from.assign(vertices, kNone);
  number.resize(vertices);
  const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t t, std::size_t k) {
    if (b < a) return;
    if (seen_from[b] != a) {
      seen_from[b] = a;
      number[b] = static_cast<std::uint32_t>(edges_.size());
      edges_.push_back({{a, b}, {kNone, kNone}, 0});
    }
    Edge& edge = edges_[number[b]];
    if (edge.triangles < 2) edge.triangle[edge.triangles] = t;
    ++edge.triangles;
    edge_of_[3 * std::size_t{t} + k] = number[b];
  };
  for (std::uint32_t a = 0; a < vertices; ++a)
    for (const std::uint32_t t : around(a))
      for (std::size_t k = 0; k < 3; ++k) {
        if (corner(t, k) != a) continue;
        add(a, corner(t, (k + 1) % 3), t, k);
        add(a, corner(t, (k + 2) % 3), t, (k + 2) % 3);
      }
  for (std::uint32_t e = 0; e < edges_.size(); ++e) {
    if (edges_[e].triangles != 1) continue;
    const std::uint32_t t = edges_[e].triangle[0];
    for (std::size_t k = 0; k < 3; ++k)
      if (edgeOf(t, k) == e) leaving_[corner(t, k)] = t;
  }
}

std::uint32_t FacetSurface::descend(std::uint32_t t, const glm::vec3& p, float& distance2, float enough2) {
  for (int step = 0; step < 4 && distance2 > enough2; ++step) {
    std::uint32_t next = t;
    for (std::size_t k = 0; k < 3; ++k) next = nearestAround(corner(t, k), p, distance2, next);
    if (next == t) break;
    t = next;
  }
  return t;
}

std::uint32_t FacetSurface::search(const glm::vec3& p, float& distance2) {
  if (!grid_) fillGrid();
  const std::uint32_t v = grid_->nearest(p, [](std::uint32_t) { return true; });
  return nearestAround(v, p, distance2, around_[fan_[v]]);
}

void FacetSurface::fillGrid() {
  std::vector<std::uint32_t> used;
  for (std::uint32_t v = 0; v + 1 < fan_.size(); ++v)
    if (fan_[v] != fan_[v + 1]) used.push_back(v);
  grid_.emplace(surface_.positions, used);
}

}  // namespace lod::build
