#include "lod/patch/builder/facet_surface.h"

#include <cmath>

#include "base/check.h"

namespace lod::patch::builder {
namespace {

// Distances to facets thinner than this share of their length are measured to their edges, since their walls are
// imprecise. The share is a choice: larger measures more facets to their edges, smaller trusts walls of larger error.
constexpr double kThin = 2.4e-3;
// Triangles whose squared sine is below this are too thin for their plane to tell where over them a point lies.
constexpr double kSure = 1e-10;

}  // namespace

void FacetTree::build(std::span<const glm::vec3> positions, std::span<const std::uint32_t> indices) {
  LUMIGRID_CHECK(!indices.empty());
  boxes_.clear(), first_.clear();
  below_.resize(indices.size() / 3);
  for (std::size_t t = 0; t < below_.size(); ++t) {
    const glm::vec3& a = positions[indices[3 * t]];
    const glm::vec3& b = positions[indices[3 * t + 1]];
    const glm::vec3& c = positions[indices[3 * t + 2]];
    below_[t] = {glm::min(glm::min(a, b), c), glm::max(glm::max(a, b), c)};
  }
  boxes_.reserve(below_.size() / 3 + kMaxLevels);
  do {
    first_.push_back(boxes_.size());
    std::size_t joined = 0;
    for (std::size_t first = 0; first < below_.size(); first += kSiblings) {
      Boxes& boxes = boxes_.emplace_back();
      base::Aabb all = below_[first];
      for (std::size_t i = 0; i < kSiblings && first + i < below_.size(); ++i) {
        const base::Aabb& box = below_[first + i];
        const glm::vec3 center = box.center();
        const glm::vec3 half = 0.5F * box.size();
        boxes.center[0][i] = center.x, boxes.center[1][i] = center.y, boxes.center[2][i] = center.z;
        boxes.half[0][i] = half.x, boxes.half[1][i] = half.y, boxes.half[2][i] = half.z;
        all.add(box);
      }
      below_[joined++] = all;
    }
    below_.resize(joined);
  } while (below_.size() > 1);
}

void FacetSurface::reset(const SurfaceView& surface) {
  surface_ = surface;
  const std::size_t triangles = surface.indices.size() / 3;
  is_computed_.assign(triangles, 0);
  if (facets_.size() < triangles) facets_.resize(triangles);
  tree_.clear();
  buildFans();
  buildEdges();
}

void FacetSurface::computeFacet(std::uint32_t t, Facet& f) {
  is_computed_[t] = 1;
  const glm::vec3 a = surface_.positions[corner(t, 0)];
  const glm::vec3 b = surface_.positions[corner(t, 1)];
  const glm::vec3 c = surface_.positions[corner(t, 2)];
  f.corners = {Facet::Four{a.x, b.x, c.x, a.x}, Facet::Four{a.y, b.y, c.y, a.y}, Facet::Four{a.z, b.z, c.z, a.z}};
  const Facet::FourPoints edge{Facet::Four{b.x, c.x, a.x, a.x} - f.corners.x,
                               Facet::Four{b.y, c.y, a.y, a.y} - f.corners.y,
                               Facet::Four{b.z, c.z, a.z, a.z} - f.corners.z};
  // Products of lattice vectors are exact in double, so a sliver's plane is as good as any.
  const glm::dvec3 n = glm::cross(glm::dvec3(edge[0]), glm::dvec3(edge[1]));
  const double area = std::sqrt(glm::dot(n, n));
  const Facet::Four length2 = edge.dot(edge);
  const float longest2 = std::max({length2[0], length2[1], length2[2]});
  f.longest = std::sqrt(longest2);
  f.flat = !(area > 0.0);
  f.thin = !(area > kThin * static_cast<double>(longest2));
  f.roughness = kEpsilon * 64.0F;
  if (f.flat) return;
  if (!f.thin) f.roughness += kEpsilon * 8.0F * longest2 / static_cast<float>(area);
  const glm::vec3 normal(n * (1.0 / area));
  Facet::Four length;
  for (std::size_t k = 0; k < 4; ++k) length[k] = std::sqrt(length2[k]);
  const Facet::Four scale = 1.0F / length;
  f.planes = {(normal.y * edge.z - edge.y * normal.z) * scale, (normal.z * edge.x - edge.z * normal.x) * scale,
              (normal.x * edge.y - edge.x * normal.y) * scale};
  f.planes.x[3] = normal.x, f.planes.y[3] = normal.y, f.planes.z[3] = normal.z;
}

FacetSurface::Spot FacetSurface::closest(std::uint32_t t, const glm::vec3& p) const {
  const glm::vec3& corner0 = surface_.positions[corner(t, 0)];
  const glm::vec3 ab = surface_.positions[corner(t, 1)] - corner0;
  const glm::vec3 ac = surface_.positions[corner(t, 2)] - corner0;
  const glm::vec3 ap = p - corner0;
  // In double, since slivers cancel most of these sums.
  const glm::dvec3 toward_b(ab);
  const glm::dvec3 toward_c(ac);
  const glm::dvec3 toward_p(ap);
  const double bb = glm::dot(toward_b, toward_b);
  const double cc = glm::dot(toward_c, toward_c);
  const double bc = glm::dot(toward_b, toward_c);
  const double pb = glm::dot(toward_b, toward_p);
  const double pc = glm::dot(toward_c, toward_p);
  const double area2 = bb * cc - bc * bc;
  Spot spot;
  float distance2 = std::numeric_limits<float>::max();
  const auto tryPoint = [&](const glm::vec2& share) {
    const glm::vec3 d = share.x * ab + share.y * ac - ap;
    if (const float d2 = glm::dot(d, d); d2 < distance2) distance2 = d2, spot.share = share;
  };
  const double b_share = cc * pb - bc * pc;
  const double c_share = bb * pc - bc * pb;
  if (area2 > kSure * bb * cc && b_share >= 0.0 && c_share >= 0.0 && b_share + c_share <= area2) {
    tryPoint(glm::vec2(glm::dvec2(b_share, c_share) / area2));
  } else {
    const float along = closestShare(ap - ab, ac - ab);
    tryPoint({1.0F - along, along});
    tryPoint({closestShare(ap, ab), 0.0F});
    tryPoint({0.0F, closestShare(ap, ac)});
  }
  // Differences of positions are exact. The shares may add up to 1 plus a rounding error, which the distance includes.
  spot.distance = std::sqrt(distance2);
  spot.distance += 16.0F * kEpsilon * (spot.distance + std::sqrt(static_cast<float>(std::max(bb, cc))));
  return spot;
}

glm::vec3 FacetSurface::valueAt(std::span<const glm::vec3> values, std::uint32_t t, const Spot& spot) const {
  return (1.0F - spot.share.x - spot.share.y) * values[corner(t, 0)] + spot.share.x * values[corner(t, 1)] +
         spot.share.y * values[corner(t, 2)];
}

// Sorts triangles by their corners and sides by the lower of their ends, both by counting.
void FacetSurface::buildFans() {
  const std::size_t vertices = surface_.positions.size();
  fan_.assign(vertices + 1, 0);
  first_side_.assign(vertices + 1, 0);
  for (std::size_t i = 0; i < surface_.indices.size(); i += 3) {
    const std::uint32_t a = surface_.indices[i];
    const std::uint32_t b = surface_.indices[i + 1];
    const std::uint32_t c = surface_.indices[i + 2];
    ++fan_[a + 1], ++fan_[b + 1], ++fan_[c + 1];
    ++first_side_[std::min(a, b) + 1], ++first_side_[std::min(b, c) + 1], ++first_side_[std::min(c, a) + 1];
  }
  for (std::size_t v = 1; v <= vertices; ++v) fan_[v] += fan_[v - 1], first_side_[v] += first_side_[v - 1];
  around_.resize(surface_.indices.size());
  sides_.resize(surface_.indices.size());
  next_.assign(fan_.begin(), fan_.end() - 1);
  next_side_.assign(first_side_.begin(), first_side_.end() - 1);
  const auto addSide = [&](std::uint32_t v, std::uint32_t w, std::uint32_t t, std::uint32_t k) {
    sides_[next_side_[std::min(v, w)]++] = {std::max(v, w), t, 3 * t + k};
  };
  for (std::uint32_t t = 0; t < triangleCount(); ++t) {
    const std::uint32_t a = corner(t, 0);
    const std::uint32_t b = corner(t, 1);
    const std::uint32_t c = corner(t, 2);
    for (const std::uint32_t v : {a, b, c}) around_[next_[v]++] = t;
    // Sides come in the order of the triangle's corners.
    addSide(a, b, t, 0), addSide(c, a, t, 2), addSide(b, c, t, 1);
  }
}

void FacetSurface::buildEdges() {
  const auto vertices = static_cast<std::uint32_t>(surface_.positions.size());
  if (edges_.size() < sides_.size() + 1) edges_.resize(sides_.size() + 1);
  edge_of_.resize(sides_.size());
  border_.assign(vertices, {});
  seen_.assign(vertices, 0);
  std::uint32_t count = 0;
  Edge* const edges = edges_.data();
  std::uint32_t* const edge_of = edge_of_.data();
  std::uint32_t* const seen = seen_.data();
  for (std::uint32_t a = 0; a < vertices; ++a) {
    const std::uint32_t first = count;
    for (std::uint32_t i = first_side_[a]; i < first_side_[a + 1]; ++i) {
      const auto [b, t, side] = sides_[i];
      // No branch could predict whether the edge is new: it is written, and the count decides whether it stays.
      const std::uint32_t number = seen[b];
      edges[count] = {{a, b}, {kNone, kNone}, 0};
      count += number <= first ? 1 : 0;
      const std::uint32_t e = (number <= first ? count : number) - 1;
      seen[b] = e + 1;
      edge_of[side] = e;
      Edge& edge = edges[e];
      if (edge.triangles < 2) edge.triangle[edge.triangles] = t;
      ++edge.triangles;
    }
  }
  edge_count_ = count;
  for (std::uint32_t e = 0; e < count; ++e) {
    if (edges[e].triangles != 1) continue;
    const std::uint32_t start = borderStart(e);
    border_[start].leaving = e;
    border_[edges[e].otherEnd(start)].arriving = e;
  }
}

std::uint32_t FacetSurface::borderStart(std::uint32_t e) const {
  const std::uint32_t t = edges_[e].triangle[0];
  return corner(t, edgeOf(t, 0) == e ? 0 : edgeOf(t, 1) == e ? 1 : 2);
}

std::uint32_t FacetSurface::over(std::uint32_t v, const glm::vec3& p, float enough, Spot& spot) {
  for (const std::uint32_t t : around(v)) {
    const Facet& f = facet(t);
    if (f.thin) continue;
    const Facet::Four in = f.inside(p);
    if (Facet::wallsWhere(in < 0.0F) != 0) continue;
    const float height = std::abs(in[3]);
    if (height > enough) continue;
    // A corner's share is the height over the opposite wall, relative to the corner's own height.
    spot.share = {in[2] / glm::dot(f.wall(2), f.corner(1) - f.corner(0)),
                  in[0] / glm::dot(f.wall(0), f.corner(2) - f.corner(0))};
    spot.distance = height * (1.0F + 8.0F * kEpsilon) + f.roughness * (f.longest + glm::length(p - f.corner(0)));
    return t;
  }
  return kNone;
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

std::uint32_t FacetSurface::search(const glm::vec3& p, float& distance2, std::uint32_t best, float enough2) {
  if (tree_.isEmpty()) tree_.build(surface_.positions, surface_.indices);
  const auto distance2To = [&](std::uint32_t t) { return facet(t).distance2(p); };
  const std::uint32_t nearer = tree_.nearest(p, distance2, enough2, distance2To);
  return nearer != FacetTree::kNone ? nearer : best;
}

}  // namespace lod::patch::builder
