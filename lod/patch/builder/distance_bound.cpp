#include "lod/patch/builder/distance_bound.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <utility>

#include "base/geometry.h"
#include "base/simd.h"
#include "lod/patch/builder/facet_surface.h"
#include "lod/patch/builder/overlay.h"
#include "lod/patch/builder/places_by_key.h"

namespace lod::patch::builder {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr float kFar = std::numeric_limits<float>::max();
// The limits and factors below are choices, made while building the meshes of docs/results/hierarchy.md; no figures
// were kept of other values. All bounds hold with any of them: they trade tightness for time.

// Where rounding may take more than this, in lattice steps, distances are measured in double. A larger slack loosens
// bounds by as much, a smaller one measures more distances in double, which takes longer (docs/decisions/slivers.md).
constexpr float kMaxSlack = 0.05F;
// The most facets that one walk visits; how often a triangle that no walk covers well is quartered; the most walks of
// all its quarters. With larger limits fewer triangles fall back to looser bounds, and the worst triangles take longer.
constexpr int kMaxVisits = 60;
constexpr int kMaxQuartering = 6;
constexpr int kMaxWalks = 400;
// A piece is not cut further if its distance is at most this share of the largest error of a vertex. A larger share
// cuts fewer pieces, whose bounds then lie nearer to that error.
constexpr float kNearShare = 0.7F;
// A bound this much above the distance of a triangle's corners is worth other walks, under limits raised by this
// factor. A smaller factor tries more walks for less.
constexpr float kRaise = 1.1F;
// Quarters of all triangles of a group together take so many walks for each triangle of the group. Where surfaces are
// torn or tangled nearly every triangle asks for quarters, and beyond this they would cost more than the
// simplification itself; triangles that get none keep their looser bound (docs/decisions/every-group-once.md).
constexpr std::int64_t kWalksPerTriangle = 1;
// A border vertex is projected onto the other border if that is at most this many times the largest error of a vertex.
// With a larger ratio it may meet a border that has nothing to do with it.
constexpr float kMaxBorderRatio = 2.0F;

// A polygon relative to some lattice point, convex up to rounding; only its corners are ever measured. Lanes up to the
// next multiple of four repeat the first corner.
struct Polygon {
  static constexpr int kMax = 24;
  int size = 0;
  float x[kMax];
  float y[kMax];
  float z[kMax];
  void add(float px, float py, float pz) { x[size] = px, y[size] = py, z[size] = pz, ++size; }
  void add(const glm::vec3& p) { add(p.x, p.y, p.z); }
  void fill() {
    for (int i = size; i % 4 != 0; ++i) x[i] = x[0], y[i] = y[0], z[i] = z[0];
  }
  glm::vec3 point(int i) const { return {x[i], y[i], z[i]}; }
};

// Writes dot(n, p) − at for all corners and returns the lowest.
float heightsOver(const Polygon& p, const glm::vec3& n, float at, float* out) {
  float low[4] = {kFar, kFar, kFar, kFar};
  for (int b = 0; b < p.size; b += 4)
    for (int i = 0; i < 4; ++i) {
      const float v = n.x * p.x[b + i] + n.y * p.y[b + i] + n.z * p.z[b + i] - at;
      out[b + i] = v;
      low[i] = v < low[i] ? v : low[i];
    }
  return std::min(std::min(low[0], low[1]), std::min(low[2], low[3]));
}

// The largest distance of a corner from the plane dot(n, p) = at.
float maxHeight(const Polygon& p, const glm::vec3& n, float at) {
  float high[4] = {0.0F, 0.0F, 0.0F, 0.0F};
  for (int b = 0; b < p.size; b += 4)
    for (int i = 0; i < 4; ++i) {
      const float v = std::abs(n.x * p.x[b + i] + n.y * p.y[b + i] + n.z * p.z[b + i] - at);
      high[i] = v > high[i] ? v : high[i];
    }
  return std::max(std::max(high[0], high[1]), std::max(high[2], high[3]));
}

// The point where the edge from an inside corner to an outside one meets the wall.
glm::vec3 crossing(const Polygon& polygon, const float* side, int in, int out) {
  const float share = side[in] / (side[in] - side[out]);
  return polygon.point(in) + share * (polygon.point(out) - polygon.point(in));
}

// Cuts a polygon along a wall that some corner lies beyond. If rounding left a polygon that crosses the wall more than
// twice, the hulls of both parts still cover it.
void cutPolygon(const Polygon& polygon, const float* side, Polygon& inside, Polygon& outside) {
  inside.size = outside.size = 0;
  const int n = polygon.size;
  std::uint32_t beyond = 0;
  for (int i = 0; i < n; ++i) beyond |= static_cast<std::uint32_t>(side[i] < 0.0F) << i;
  const std::uint32_t all = (1U << n) - 1;
  if (beyond == all) {
    outside = polygon;
    return;
  }
  const std::uint32_t starts = beyond & ~(beyond << 1 | beyond >> (n - 1));
  const int first = std::countr_zero(starts);
  if ((starts & (starts - 1)) == 0) {
    // One run of corners lies beyond, as in any convex polygon.
    const int count = std::popcount(beyond);
    int i = first;
    const glm::vec3 enter = crossing(polygon, side, i > 0 ? i - 1 : n - 1, i);
    outside.add(enter);
    int last = i;
    for (int c = 0; c < count; ++c, i = i + 1 < n ? i + 1 : 0)
      outside.add(polygon.x[i], polygon.y[i], polygon.z[i]), last = i;
    const glm::vec3 leave = crossing(polygon, side, i, last);
    outside.add(leave);
    inside.add(leave);
    for (int c = count; c < n; ++c, i = i + 1 < n ? i + 1 : 0) inside.add(polygon.x[i], polygon.y[i], polygon.z[i]);
    inside.add(enter);
  } else {
    for (int i = 0; i < n; ++i) {
      const int j = i + 1 < n ? i + 1 : 0;
      const bool here = side[i] < 0.0F;
      const bool there = side[j] < 0.0F;
      (here ? outside : inside).add(polygon.point(i));
      if (here == there) continue;
      const glm::vec3 p = here ? crossing(polygon, side, j, i) : crossing(polygon, side, i, j);
      inside.add(p);
      outside.add(p);
    }
  }
  inside.fill();
  outside.fill();
}

// Where target facets are looked for first: the target vertices that a source vertex came to lie near, and the facet
// that a source triangle became.
struct Hints : PlacesByKey {         // by source vertex
  std::vector<std::uint32_t> image;  // per source triangle; kNone: it vanished
};

// A piece of a source triangle on a target facet. No point of the piece is farther from the facet than `distance`.
struct ProjectedPiece {
  std::uint32_t facet = 0;
  float distance = 0.0F;
};

// Where source vertices lie on a target, as Overlay::compute() takes them. Nearer facets that are found later are not
// entered: a border vertex stays on the facet of its border edge.
struct VertexPlaces {
  std::vector<std::uint32_t> facet;
  std::vector<std::uint32_t> twin;
  std::vector<std::uint32_t> border;
  std::vector<Overlay::Gap> gap;
  std::vector<float> shading;  // how far unit normals differ; empty for surfaces without normals
};

// The distance of two normals' ends, made unit; 0 where one has no direction.
float turnBetween(const glm::vec3& a, const glm::vec3& b) {
  const float lengths = glm::length(a) * glm::length(b);
  return lengths > 0.0F ? std::sqrt(std::max(0.0F, 2.0F - 2.0F * glm::dot(a, b) / lengths)) : 0.0F;
}

// Projects the triangles of a source surface onto a target surface.
class Projector {
 public:
  Projector(const SurfaceView& source, FacetSurface& target, const Hints& hints, std::vector<std::uint32_t>& facet)
      : source_(source), target_(target), hints_(hints), facet_(facet) {
    facet_.assign(source.positions.size(), kNone);
    is_nearest_.assign(source.positions.size(), 0);
    walks_left_ = kWalksPerTriangle * static_cast<std::int64_t>(source.indices.size() / 3);
  }

  // Finds where each vertex lies. Returns the largest of its distances, and of `known`.
  float placeVertices(const FacetSurface& source, const CollapseHistory& history, float known, VertexPlaces& placed) {
    const auto& below = target_.view().positions;
    placed.twin.assign(source_.positions.size(), kNone);
    placed.border.assign(source_.positions.size(), kNone);
    placed.gap.assign(source_.positions.size(), {});
    const bool has_normal = !source_.normals.empty() && !target_.view().normals.empty();
    placed.shading.assign(has_normal ? source_.positions.size() : 0, 0.0F);
    const bool has_color = !source_.colors.empty() && !target_.view().colors.empty();
    for (std::uint32_t v = 0; v < facet_.size(); ++v) {
      if (source.around(v).empty()) continue;
      const std::uint32_t kept = history.survivor[v];
      const std::uint32_t leaving = target_.leavingBorder(kept);
      Overlay::Gap& gap = placed.gap[v];
      if (below[kept] == source_.positions[v] && !target_.around(kept).empty()) {
        placed.border[v] = leaving;
        facet_[v] = leaving != kNone ? target_.edges()[leaving].triangle[0] : target_.around(kept)[0];
        placed.twin[v] = kept;
        if (has_color) gap.color = glm::length(source_.colors[v] - target_.view().colors[kept]);
        continue;
      }
      FacetSurface::Spot spot;
      facet_[v] = target_.over(kept, source_.positions[v], known, spot);
      if (facet_[v] == kNone) spot = target_.closest(nearFacet(v, known), source_.positions[v]);
      known = std::max(known, spot.distance);
      gap.distance = spot.distance;
      if (has_color) gap.color = glm::length(source_.colors[v] - target_.colorAt(facet_[v], spot));
      if (has_normal) placed.shading[v] = turnBetween(source_.normals[v], target_.normalAt(facet_[v], spot));
      if (leaving != kNone && source.leavingBorder(v) != kNone) placeOnBorder(v, kept, known, placed);
    }
    placed.facet = facet_;
    return known;
  }

  float usual() const { return usual_; }

  // The facet nearest to vertex v, or one within `enough`.
  ProjectedPiece nearestFacet(std::uint32_t v, float enough) {
    const std::uint32_t facet = nearFacet(v, enough);
    return {facet, std::sqrt(target_.facet(facet).distance2(source_.positions[v]))};
  }

  // Pieces within `enough` of their facet are not cut further; triangles within `usual` are not projected again.
  void setLimits(float enough, float usual) { enough_ = enough, usual_ = usual; }

  // Projects source triangle t in one piece from where it may lie. True if all pieces() are within `allowed` or the
  // largest distance so far; else maxDistance() is a bound that projectClosely() may lower.
  bool project(std::uint32_t t, float allowed) {
    return withAllowed(allowed, [&] { return projectWhole(t); });
  }
  // The same in quarters, as far as walks are left for them. Triangles that lie farthest should come first: what they
  // need the others may have for nothing.
  void projectClosely(std::uint32_t t, float allowed) {
    withAllowed(allowed, [&] {
      if (!projectWhole(t)) projectQuarters(t);
      return true;
    });
    usual_ = std::max(usual_, best_);
  }
  // The pieces of the last triangle, which together cover it.
  const std::vector<ProjectedPiece>& pieces() const { return kept_; }
  // The largest distance of a piece of the last triangle.
  float maxDistance() const { return best_; }

 private:
  template <class Project>
  bool withAllowed(float allowed, Project&& project) {
    allowed_ = std::min(allowed, usual_);
    const float enough = std::exchange(enough_, std::min(enough_, allowed_));
    const bool is_near = project();
    enough_ = enough;
    return is_near;
  }

  bool projectWhole(std::uint32_t t) {
    const std::uint32_t* c = &source_.indices[3 * std::size_t{t}];
    origin_ = source_.positions[c[0]];
    const glm::vec3 p[3] = {glm::vec3(0.0F), source_.positions[c[1]] - origin_, source_.positions[c[2]] - origin_};
    reach_ = std::max(glm::length(p[1]), glm::length(p[2]));
    const Polygon whole = triangle(p);

    best_ = kFar;
    if (const std::uint32_t image = hints_.image[t]; image != kNone && tryWalkFrom(whole, image)) return true;
    std::uint32_t near[3];
    for (int k = 0; k < 3; ++k) {
      near[k] = nearFacet(c[k], allowed_);
      if ((k > 0 && near[k] == near[0]) || (k > 1 && near[k] == near[1])) continue;
      if (tryWalkFrom(whole, near[k])) return true;
    }
    for (int k = 0; k < 3; ++k)
      if (const std::uint32_t nearest = nearFacet(c[k], 0.0F); nearest != near[k] && tryWalkFrom(whole, nearest))
        return true;
    return false;
  }

  // After projectWhole() of the same triangle.
  void projectQuarters(std::uint32_t t) {
    const std::uint32_t* c = &source_.indices[3 * std::size_t{t}];
    const glm::vec3 p[3] = {glm::vec3(0.0F), source_.positions[c[1]] - origin_, source_.positions[c[2]] - origin_};
    // No walk can come below the distances of the corners.
    float needed = allowed_;
    for (int k = 0; k < 3; ++k)
      needed = std::max(needed, std::sqrt(target_.facet(nearFacet(c[k], 0.0F)).distance2(source_.positions[c[k]])));
    for (float limit = kRaise * needed + 1e-3F; limit < best_ && walks_left_ > 0;
         limit = kRaise * std::max(limit, beyond_)) {
      pieces_.clear(), abort_ = limit, worst_ = 0.0F, walks_ = kMaxWalks, beyond_ = 0.0F;
      const bool is_covered = quarters(p, c, kMaxQuartering);
      walks_left_ -= kMaxWalks - walks_;
      if (!is_covered) continue;
      best_ = worst_, kept_.swap(pieces_);
      break;
    }
  }

  // Places v on the nearer one of the border edges at vertex `kept` of the target, if that is near enough.
  void placeOnBorder(std::uint32_t v, std::uint32_t kept, float near, VertexPlaces& placed) {
    const bool has_color = !source_.colors.empty() && !target_.view().colors.empty();
    float nearest = kMaxBorderRatio * near;
    for (const std::uint32_t e : {target_.leavingBorder(kept), target_.arrivingBorder(kept)}) {
      if (e == kNone) continue;
      const auto [a, b] = target_.edges()[e].vertex;
      const glm::vec3 ab = target_.view().positions[b] - target_.view().positions[a];
      const glm::vec3 ap = source_.positions[v] - target_.view().positions[a];
      const float share = closestShare(ap, ab);
      const float d = glm::length(ap - share * ab);
      if (d >= nearest) continue;
      nearest = d;
      placed.border[v] = e;
      facet_[v] = target_.edges()[e].triangle[0];
      placed.gap[v].distance = d + 16.0F * kEpsilon * (d + glm::length(ab));
      if (has_color)
        placed.gap[v].color =
            glm::length(source_.colors[v] - glm::mix(target_.view().colors[a], target_.view().colors[b], share));
    }
  }

  static Polygon triangle(const glm::vec3* p) {
    Polygon out;
    for (int k = 0; k < 3; ++k) out.add(p[k]);
    out.fill();
    return out;
  }

  // Walks from facet `start` and keeps the pieces if they are the nearest so far. True if they are near enough.
  bool tryWalkFrom(const Polygon& whole, std::uint32_t start) {
    pieces_.clear(), abort_ = best_, worst_ = 0.0F, visits_ = kMaxVisits;
    if (walk(whole, start, kNone) && worst_ < best_) best_ = worst_, kept_.swap(pieces_);
    return best_ <= allowed_;
  }

  // Adds a piece on facet t at that distance and what rounding may hide. False if it is too far.
  bool addPiece(std::uint32_t t, const Facet& facet, const Polygon& polygon, float distance) {
    float slack = facet.roughness * (reach_ + facet.longest + glm::length(facet.corner(0) - origin_));
    if (slack > kMaxSlack) {
      distance = exactDistance(polygon, facet);
      slack = 8.0F * kEpsilon * reach_;
    }
    distance = distance * (1.0F + 8.0F * kEpsilon) + slack;
    if (distance >= abort_) return false;
    worst_ = std::max(worst_, distance);
    pieces_.push_back({t, distance});
    return true;
  }

  // The largest distance of the polygon's corners from the facet, in double.
  float exactDistance(const Polygon& polygon, const Facet& facet) const {
    double worst2 = 0.0;
    const glm::dvec3 corner[3] = {glm::dvec3(facet.corner(0)), glm::dvec3(facet.corner(1)),
                                  glm::dvec3(facet.corner(2))};
    for (int i = 0; i < polygon.size; ++i) {
      const glm::dvec3 p = glm::dvec3(origin_) + glm::dvec3(polygon.point(i));
      const glm::dvec3 d = p - base::closestPointOnTriangle(p, corner[0], corner[1], corner[2]);
      worst2 = std::max(worst2, glm::dot(d, d));
    }
    return static_cast<float>(std::sqrt(worst2));
  }

  // The same in float; once it exceeds `enough`, any number above that.
  float distanceOf(const Polygon& polygon, const Facet& facet, float enough) const {
    float worst2 = 0.0F;
    for (int i = 0; i < polygon.size && worst2 <= enough * enough; ++i)
      worst2 = std::max(worst2, facet.distance2(origin_ + polygon.point(i)));
    return std::sqrt(worst2);
  }

  // The same when the corners' heights over the walls and the largest height over the plane are known.
  float distanceOf(const Polygon& polygon, const Facet& facet, const float (&side)[3][Polygon::kMax],
                   float height) const {
    if (facet.thin) return distanceOf(polygon, facet, enough_);
    const float enough2 = enough_ * enough_;
    float worst2 = height * height;
    for (int i = 0; i < polygon.size && worst2 <= enough2; ++i) {
      const Facet::Four edges2 = facet.edgeDistances2(origin_ + polygon.point(i));
      float best2 = kFar;
      for (int k = 0; k < 3; ++k)
        if (side[k][i] < 0.0F) best2 = std::min(best2, edges2[k]);
      if (best2 < kFar) worst2 = std::max(worst2, best2);
    }
    return std::sqrt(worst2);
  }

  // Projects a polygon from facet t on, coming from facet `from`. False if some piece is too far from its facet.
  bool walk(const Polygon& polygon, std::uint32_t t, std::uint32_t from) {
    const Facet& facet = target_.facet(t);
    if (facet.flat) return addPiece(t, facet, polygon, distanceOf(polygon, facet, kFar));
    float side[3][Polygon::kMax];
    float at[3];
    float low[3];
    for (int k = 0; k < 3; ++k) {
      at[k] = glm::dot(facet.wall(k), facet.corner(k) - origin_);
      low[k] = heightsOver(polygon, facet.wall(k), at[k], side[k]);
    }
    const float plane = glm::dot(facet.normal(), facet.corner(0) - origin_);
    const float height = maxHeight(polygon, facet.normal(), plane);
    const float lowest = std::min({low[0], low[1], low[2]});
    if (lowest >= 0.0F) return addPiece(t, facet, polygon, facet.thin ? distanceOf(polygon, facet, kFar) : height);
    if (height <= enough_ && lowest >= -enough_)
      if (const float d = distanceOf(polygon, facet, side, height); d <= enough_) return addPiece(t, facet, polygon, d);
    if (--visits_ < 0) return addPiece(t, facet, polygon, distanceOf(polygon, facet, abort_));

    // The part beyond each wall walks on; the wall that the polygon came over is the last. A part beyond that one alone
    // lies in the wedge over the shared edge, where no neighbour is nearer than this facet.
    int order[3] = {0, 1, 2};
    if (from != kNone)
      for (int k = 0; k < 2; ++k)
        if (target_.neighbor(t, static_cast<std::size_t>(order[k])) == from) std::swap(order[k], order[2]);
    const Polygon* rest = &polygon;
    Polygon inside[2];
    Polygon outside;
    int turn = 0;
    bool is_cut = false;
    for (const int k : order) {
      if (low[k] >= 0.0F) continue;
      if (is_cut) low[k] = heightsOver(*rest, facet.wall(k), at[k], side[k]);
      if (!(low[k] < 0.0F)) continue;
      if (2 * rest->size > Polygon::kMax) break;
      cutPolygon(*rest, side[k], inside[turn], outside);
      const std::uint32_t next = target_.neighbor(t, static_cast<std::size_t>(k));
      const bool goes_on = next != kNone && next != from;
      const float enough = goes_on ? enough_ : abort_;
      const float d = -low[k] <= enough && (!goes_on || height <= enough_) ? distanceOf(outside, facet, enough) : kFar;
      if (d <= enough || !goes_on) {
        if (!addPiece(t, facet, outside, d)) return false;
      } else if (!walk(outside, next, t)) {
        return false;
      }
      if (inside[turn].size == 0) return true;
      is_cut = true;
      rest = &inside[turn];
      turn = 1 - turn;
    }
    const bool over = 2 * rest->size > Polygon::kMax || facet.thin;
    return addPiece(t, facet, *rest, over ? distanceOf(*rest, facet, abort_) : maxHeight(*rest, facet.normal(), plane));
  }

  // A facet near a source vertex: one within `enough`, or else the nearest.
  std::uint32_t nearFacet(std::uint32_t v, float enough) {
    const glm::vec3& p = source_.positions[v];
    const float enough2 = enough * enough;
    std::uint32_t& near = facet_[v];
    if (is_nearest_[v] != 0) return near;
    float d2 = kFar;
    if (near != kNone)
      d2 = target_.facet(near).distance2(p);
    else
      for (std::uint32_t i = hints_.first[v]; i < hints_.first[v + 1]; ++i)
        near = target_.nearestAround(hints_.member[i], p, d2, near, 0.5F * enough2);
    if (near != kNone && d2 > enough2) near = target_.descend(near, p, d2, enough2);
    if (d2 <= enough2) return near;
    // Where pieces vanish nothing leads to a facet. One that was found for a vertex beside it leaves less to search.
    if (near == kNone && last_found_ != kNone) near = last_found_, d2 = target_.facet(near).distance2(p);
    last_found_ = near = target_.search(p, d2, near, enough2);
    is_nearest_[v] = d2 > enough2 ? 1 : 0;
    return near;
  }

  bool quarters(const glm::vec3* p, const std::uint32_t* c, int depth) {
    const glm::vec3 m[3] = {0.5F * (p[0] + p[1]), 0.5F * (p[1] + p[2]), 0.5F * (p[2] + p[0])};
    const glm::vec3 parts[4][3] = {{p[0], m[0], m[2]}, {m[0], p[1], m[1]}, {m[2], m[1], p[2]}, {m[0], m[1], m[2]}};
    for (const auto& part : parts)
      if (!quarter(part, c) && (depth <= 1 || walks_ < 0 || beyond_ > 0.0F || !quarters(part, c, depth - 1)))
        return false;
    return true;
  }
  bool quarter(const glm::vec3* part, const std::uint32_t* c) {
    const glm::vec3 center = origin_ + (part[0] + part[1] + part[2]) / 3.0F;
    float d2 = target_.facet(facet_[c[0]]).distance2(center);
    const std::uint32_t near = target_.descend(facet_[c[0]], center, d2, 0.0F);
    if (tryWalk(part, near)) return true;
    const std::uint32_t nearest = target_.search(center, d2, near);
    // No facet is nearer to this place.
    if (d2 > abort_ * abort_) {
      beyond_ = std::sqrt(d2);
      return false;
    }
    if (nearest != near && tryWalk(part, nearest)) return true;
    // At an edge of many facets a walk may lead around the nearest one, which may be good enough by itself.
    const Polygon whole = triangle(part);
    const Facet& facet = target_.facet(nearest);
    return addPiece(nearest, facet, whole, distanceOf(whole, facet, abort_));
  }
  bool tryWalk(const glm::vec3* part, std::uint32_t start) {
    const std::size_t pieces = pieces_.size();
    const float worst = worst_;
    --walks_;
    visits_ = kMaxVisits;
    if (walk(triangle(part), start, kNone)) return true;
    pieces_.resize(pieces), worst_ = worst;
    return false;
  }

  SurfaceView source_;
  FacetSurface& target_;
  const Hints& hints_;
  std::vector<std::uint32_t>& facet_;     // per source vertex: the nearest facet found so far
  std::vector<std::uint8_t> is_nearest_;  // 1: no other facet is nearer
  std::uint32_t last_found_ = kNone;      // by the last search
  float enough_ = 0.0F;
  float usual_ = 0.0F;
  float allowed_ = 0.0F;
  std::int64_t walks_left_ = 0;  // of quarters
  // The following describe the triangle that is projected.
  glm::vec3 origin_{0.0F};
  float reach_ = 0.0F;
  float best_ = 0.0F;
  std::vector<ProjectedPiece> kept_;
  // The following describe the current walk.
  std::vector<ProjectedPiece> pieces_;
  float abort_ = 0.0F;
  float worst_ = 0.0F;
  int visits_ = 0;
  int walks_ = 0;
  float beyond_ = 0.0F;  // the distance of a place of the triangle, above abort_; 0: none is known
};

void forwardHints(const SurfaceView& before, const CollapseHistory& history, Hints& hints) {
  hints.first.resize(history.survivor.size() + 1);
  for (std::uint32_t v = 0; v < hints.first.size(); ++v) hints.first[v] = v;
  hints.member = history.survivor;
  hints.image.assign(before.indices.size() / 3, kNone);
  for (std::uint32_t t = 0; t < history.origin.size(); ++t) hints.image[history.origin[t]] = t;
}

// For each vertex of the simplified mesh, the vertices that were collapsed into it.
void backwardHints(const CollapseHistory& history, Hints& hints) {
  listPlaces(history.survivor, history.survivor.size(), hints);
  hints.image = history.origin;
}

// Bounds of a triangle that rise pair by pair: toward, from, the largest pair, colour.
using PairBounds = base::Float4;
constexpr PairBounds kNoBounds{-kFar, -kFar, -kFar, -kFar};

// A triangle that no walk in one piece brought near.
struct FarTriangle {
  float distance = 0.0F;
  std::uint32_t triangle = 0;
  bool operator<(const FarTriangle& other) const {
    return distance != other.distance ? distance > other.distance : triangle < other.triangle;
  }
};

// The memory of one call of carryError(), kept for the thread's next one.
struct Scratch {
  FacetSurface after;
  Hints forward;
  Hints backward;
  std::vector<std::uint32_t> facet[2];
  VertexPlaces placed;
  std::vector<PairBounds> carried_by_edge;  // per edge before
  std::vector<PairBounds> raised;           // per triangle after
  std::vector<FarTriangle> far;             // the farthest first
  Overlay overlay;
};

bool isUnchanged(const SurfaceView& before, std::uint32_t s, const SurfaceView& after, std::uint32_t t) {
  for (std::size_t k = 0; k < 3; ++k)
    if (before.positions[before.indices[3 * std::size_t{s} + k]] !=
        after.positions[after.indices[3 * std::size_t{t} + k]])
      return false;
  return true;
}

// The largest difference of colours of triangles s and t that lie on each other, corner by corner.
float cornerDifference(const SurfaceView& before, std::uint32_t s, const SurfaceView& after, std::uint32_t t) {
  float largest = 0.0F;
  if (before.colors.empty() || after.colors.empty()) return largest;
  for (std::size_t k = 0; k < 3; ++k)
    largest = std::max(largest, glm::length(before.colors[before.indices[3 * std::size_t{s} + k]] -
                                            after.colors[after.indices[3 * std::size_t{t} + k]]));
  return largest;
}

// The largest difference of any colour of triangle s from any of triangle t.
float largestDifference(const SurfaceView& before, std::uint32_t s, const SurfaceView& after, std::uint32_t t) {
  float largest = 0.0F;
  if (before.colors.empty() || after.colors.empty()) return largest;
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t j = 0; j < 3; ++j)
      largest = std::max(largest, glm::length(before.colors[before.indices[3 * std::size_t{s} + k]] -
                                              after.colors[after.indices[3 * std::size_t{t} + j]]));
  return largest;
}

// a + b, rounded up.
float sum(float a, float b) {
  return a == 0.0F ? b : b == 0.0F ? a : (a + b) * (1.0F + kEpsilon);
}

// The bound that triangle s carries; zero when none is carried.
float carried(const std::vector<float>& error, std::uint32_t s) {
  return error.empty() ? 0.0F : error[s];
}

// The largest error of a vertex before: its distance on top of what its triangles carry. How triangles are projected
// has no influence on it, so bounds up to this one cost nothing, and triangles above it are worth another walk.
float errorOfVerticesBefore(const SurfaceView& before, const SurfaceError& error, Projector& forward,
                            const std::vector<Overlay::Gap>& gap) {
  float needed = 0.0F;
  for (std::size_t i = 0; i < before.indices.size(); i += 3) {
    const float toward = carried(error.toward, static_cast<std::uint32_t>(i / 3));
    needed = std::max(needed, toward);
    for (const std::uint32_t v : before.indices.subspan(i, 3)) {
      if (toward + gap[v].distance <= needed) continue;
      needed = std::max(needed, toward + std::min(gap[v].distance, forward.nearestFacet(v, needed - toward).distance));
    }
  }
  return needed;
}

// The same for the vertices after, if that is more than `known`.
float errorOfVerticesAfter(const SurfaceError& error, Overlay& overlay, Projector& backward, float known) {
  const float carries = error.from.empty() ? 0.0F : *std::max_element(error.from.begin(), error.from.end());
  overlay.forEachEnclosed([&](std::uint32_t v, float distance) {
    if (carries + distance <= known) return;
    const ProjectedPiece near = backward.nearestFacet(v, std::max(known - carries, 0.0F));
    known = std::max(known, carried(error.from, near.facet) + near.distance);
  });
  return known;
}

// One call of carryError(), step by step. `before` lies above and `after` below in the overlay.
class ErrorCarrier {
 public:
  ErrorCarrier(FacetSurface& surface, const SurfaceError& carried_before, const SurfaceView& after,
               const CollapseHistory& history, Scratch& scratch)
      : surface_(surface),
        before_(surface.view()),
        after_(after),
        carried_(carried_before),
        history_(history),
        scratch_(prepared(scratch, before_, after, history)),
        overlay_(scratch.overlay),
        forward_(before_, scratch.after, scratch.forward, scratch.facet[0]),
        backward_(after, surface, scratch.backward, scratch.facet[1]),
        has_color_(!before_.colors.empty() && !after.colors.empty()) {}

  SurfaceError run(float negligible) {
    layOver(negligible);
    const std::size_t triangles = after_.indices.size() / 3;
    result_.toward.assign(triangles, 0.0F);
    result_.from.assign(triangles, 0.0F);
    if (has_color_) result_.color.assign(triangles, 0.0F);
    scratch_.carried_by_edge.assign(surface_.edges().size(), kNoBounds);
    scratch_.raised.assign(triangles, PairBounds{});
    boundTrianglesBefore();
    boundEdgesBefore();
    boundTrianglesAfter();
    return std::move(result_);
  }

  // The vertices before are samples of the surface, each for a third of its triangles' areas: between them the surfaces
  // mostly lie nearer to each other.
  TypicalError typical() const {
    double area_sum = 0.0, distance2 = 0.0, color2 = 0.0, shading2 = 0.0;
    const VertexPlaces& placed = scratch_.placed;
    for (std::size_t i = 0; i < before_.indices.size(); i += 3) {
      const std::uint32_t* c = &before_.indices[i];
      const glm::vec3& a = before_.positions[c[0]];
      const auto area =
          static_cast<double>(glm::length(glm::cross(before_.positions[c[1]] - a, before_.positions[c[2]] - a)));
      area_sum += area;
      for (std::size_t k = 0; k < 3; ++k) {
        const Overlay::Gap& gap = placed.gap[c[k]];
        distance2 += area / 3.0 * static_cast<double>(gap.distance) * static_cast<double>(gap.distance);
        color2 += area / 3.0 * static_cast<double>(gap.color) * static_cast<double>(gap.color);
        if (placed.shading.empty()) continue;
        shading2 += area / 3.0 * static_cast<double>(placed.shading[c[k]]) * static_cast<double>(placed.shading[c[k]]);
      }
    }
    if (!(area_sum > 0.0)) return {};
    return {static_cast<float>(std::sqrt(distance2 / area_sum)), static_cast<float>(std::sqrt(color2 / area_sum)),
            static_cast<float>(std::sqrt(shading2 / area_sum))};
  }

 private:
  static Scratch& prepared(Scratch& scratch, const SurfaceView& before, const SurfaceView& after,
                           const CollapseHistory& history) {
    scratch.after.reset(after);
    forwardHints(before, history, scratch.forward);
    backwardHints(history, scratch.backward);
    return scratch;
  }

  // Computes the overlay, and the limits that follow from the errors of the vertices.
  void layOver(float negligible) {
    VertexPlaces& placed = scratch_.placed;
    float usual = forward_.placeVertices(surface_, history_, negligible, placed);
    const float error_before = std::max(negligible, errorOfVerticesBefore(before_, carried_, forward_, placed.gap));
    overlay_.compute(surface_, scratch_.after, placed.facet, placed.gap, placed.twin, placed.border);
    // The largest distance of any vertex; some that the overlay put farther off are nearer to another triangle.
    overlay_.forEachEnclosed([&](std::uint32_t v, float distance) {
      if (distance > usual) usual = std::max(usual, backward_.nearestFacet(v, usual).distance);
    });
    const float enough = std::max(negligible, kNearShare * usual);
    forward_.setLimits(enough, usual);
    backward_.setLimits(enough, usual);
    free_error_ = errorOfVerticesAfter(carried_, overlay_, backward_, error_before);
  }

  // Each triangle before either lets its pairs of the overlay count, or is projected onto the surface after.
  void boundTrianglesBefore() {
    scratch_.far.clear();
    for (std::uint32_t s = 0; s < before_.indices.size() / 3; ++s) {
      if (isSame(s)) {
        const std::uint32_t image = scratch_.forward.image[s];
        raise(result_.toward[image], carried(carried_.toward, s));
        raiseColor(image, s, cornerDifference(before_, s, after_, image));
        if (overlay_.coversAbove(s)) countPairs(s, -kFar);
        continue;
      }
      const float distance = overlay_.distance(s);
      if (overlay_.coversAbove(s) && distance <= forward_.usual() &&
          carried(carried_.toward, s) + distance <= free_error_)
        countPairs(s, carried(carried_.toward, s));
      else if (forward_.project(s, allowedBefore(s)))
        addPiecesBefore(s);
      else
        scratch_.far.push_back({forward_.maxDistance(), s});
    }
    forEachFar([&](std::uint32_t s) {
      forward_.projectClosely(s, allowedBefore(s));
      addPiecesBefore(s);
    });
  }

  // Calls body(triangle) for those that were put off.
  template <class Body>
  void forEachFar(Body&& body) {
    std::sort(scratch_.far.begin(), scratch_.far.end());
    for (const FarTriangle& far : scratch_.far) body(far.triangle);
  }

  // How far the pieces of a triangle before may be off for nothing.
  float allowedBefore(std::uint32_t s) const { return std::max(free_error_ - carried(carried_.toward, s), 0.0F); }

  // Triangle s was projected; its pairs of the overlay count if they are no farther off.
  void addPiecesBefore(std::uint32_t s) {
    const float toward = carried(carried_.toward, s);
    const bool is_near = overlay_.coversAbove(s) && overlay_.distance(s) <= forward_.maxDistance();
    if (overlay_.coversAbove(s)) countPairs(s, is_near ? toward : -kFar);
    if (is_near) return;
    for (const ProjectedPiece& piece : forward_.pieces()) {
      raise(result_.toward[piece.facet], sum(toward, piece.distance));
      raiseColor(piece.facet, s, largestDifference(before_, s, after_, piece.facet));
    }
  }

  // The pairs within triangle s count with what it carries; those on its edges with the most of their triangles.
  void countPairs(std::uint32_t s, float toward) {
    const PairBounds carried_here{toward, carried(carried_.from, s), 0.0F, carried(carried_.color, s)};
    overlay_.forEachPairWithin(s, [&](std::uint32_t t, const Overlay::Gap& gap) { raisePair(carried_here, t, gap); });
    for (std::size_t k = 0; k < 3; ++k) {
      PairBounds& by_edge = scratch_.carried_by_edge[surface_.edgeOf(s, k)];
      by_edge = carried_here > by_edge ? carried_here : by_edge;
    }
  }

  void boundEdgesBefore() {
    for (std::uint32_t e = 0; e < scratch_.carried_by_edge.size(); ++e) {
      const PairBounds by_edge = scratch_.carried_by_edge[e];
      overlay_.forEachPairOfEdge(e, [&](std::uint32_t t, const Overlay::Gap& gap) { raisePair(by_edge, t, gap); });
    }
  }

  // Each triangle after takes the bound of its pairs, or is projected onto the surface before.
  void boundTrianglesAfter() {
    scratch_.far.clear();
    for (std::uint32_t t = 0; t < result_.from.size(); ++t) {
      const PairBounds raised = scratch_.raised[t];
      raise(result_.toward[t], raised[0]);
      if (has_color_) raise(result_.color[t], raised[3]);
      if (isUnchanged(before_, history_.origin[t], after_, t))
        result_.from[t] = carried(carried_.from, history_.origin[t]);
      else if (overlay_.coversBelow(t) && raised[2] <= backward_.usual() && raised[1] <= free_error_)
        result_.from[t] = raised[1];
      else if (backward_.project(t, allowedAfter(t)))
        addPiecesAfter(t);
      else
        scratch_.far.push_back({backward_.maxDistance(), t});
    }
    forEachFar([&](std::uint32_t t) {
      backward_.projectClosely(t, allowedAfter(t));
      addPiecesAfter(t);
    });
  }

  float allowedAfter(std::uint32_t t) const {
    return std::max(free_error_ - carried(carried_.from, history_.origin[t]), 0.0F);
  }

  void addPiecesAfter(std::uint32_t t) {
    const float pairs = scratch_.raised[t][1];
    for (const ProjectedPiece& piece : backward_.pieces())
      raise(result_.from[t], sum(carried(carried_.from, piece.facet), piece.distance));
    if (overlay_.coversBelow(t) && pairs <= result_.from[t]) {
      result_.from[t] = pairs;
      return;
    }
    for (const ProjectedPiece& piece : backward_.pieces())
      raiseColor(t, piece.facet, largestDifference(before_, piece.facet, after_, t));
  }

  bool isSame(std::uint32_t s) const {
    const std::uint32_t image = scratch_.forward.image[s];
    return image != kNone && isUnchanged(before_, s, after_, image);
  }

  static void raise(float& to, float value) { to = std::max(to, value); }
  void raiseColor(std::uint32_t t, std::uint32_t s, float difference) {
    if (has_color_) raise(result_.color[t], sum(carried(carried_.color, s), difference));
  }
  // Lane by lane as sum(): exact where nothing is added.
  LUMIGRID_ALWAYS_INLINE void raisePair(const PairBounds& from, std::uint32_t t, const Overlay::Gap& gap) {
    const PairBounds add{gap.distance, gap.distance, gap.distance, gap.color};
    const PairBounds exact = from + add;
    const PairBounds value = add > 0.0F ? exact * (1.0F + kEpsilon) : exact;
    PairBounds& raised = scratch_.raised[t];
    raised = value > raised ? value : raised;
  }

  FacetSurface& surface_;
  const SurfaceView& before_;
  const SurfaceView& after_;
  const SurfaceError& carried_;
  const CollapseHistory& history_;
  Scratch& scratch_;
  Overlay& overlay_;
  Projector forward_;
  Projector backward_;
  const bool has_color_;
  float free_error_ = 0.0F;  // bounds up to this one need not be lowered
  SurfaceError result_;
};

// A code is the upper bits of a float less those of 1/16, plus 1.
constexpr std::uint32_t kDroppedBits = 12;
constexpr std::uint32_t kMinBits = std::bit_cast<std::uint32_t>(1.0F / 16.0F);
constexpr auto kMaxBits = std::bit_cast<std::uint32_t>(static_cast<float>(1 << 22));
static_assert(((kMaxBits - kMinBits) >> kDroppedBits) + 1 < (1U << 16));

}  // namespace

SurfaceError carryError(FacetSurface& before, const SurfaceError& before_error, const SurfaceView& after,
                        const CollapseHistory& history, float negligible, TypicalError* typical) {
  thread_local std::unique_ptr<Scratch> scratch;
  if (!scratch) scratch = std::make_unique<Scratch>();
  ErrorCarrier carrier(before, before_error, after, history, *scratch);
  SurfaceError result = carrier.run(negligible);
  if (typical != nullptr) *typical = carrier.typical();
  return result;
}

std::uint16_t errorCode(float error) {
  if (!(error > 0.0F)) return 0;
  // Floats that are not negative sort as their bits do.
  const std::uint32_t bits = std::clamp(std::bit_cast<std::uint32_t>(error), kMinBits, kMaxBits);
  return static_cast<std::uint16_t>(((bits - kMinBits + (1U << kDroppedBits) - 1) >> kDroppedBits) + 1);
}

float errorOfCode(std::uint16_t code) {
  if (code == 0) return 0.0F;
  return std::bit_cast<float>(kMinBits + ((code - 1U) << kDroppedBits));
}

}  // namespace lod::patch::builder
