#include "lod/patch/builder/distance_bound.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "base/geometry.h"
#include "lod/patch/builder/facet_surface.h"
#include "lod/patch/builder/overlay.h"

namespace lod::patch::builder {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr float kFar = std::numeric_limits<float>::max();
constexpr float kEpsilon = std::numeric_limits<float>::epsilon();
// Where rounding may hide so much, in lattice steps, distances are measured in double.
constexpr float kSlack = 0.05F;
// Most facets that one walk visits; how often a triangle that no walk covers well is quartered, and how many walks all
// its parts may take.
constexpr int kMaxVisits = 60;
constexpr int kMaxQuartering = 6;
constexpr int kMaxWalks = 400;
// A piece so near, as a share of what the group costs anyway, is not cut further.
constexpr float kEnough = 0.7F;
// A bound so much above what the corners need is worth other walks; those try limits raised by this factor.
constexpr float kRaise = 1.1F;
// What is off by more than this share of what vertices need is an outlier.
constexpr float kOutlying = 0.8F;
// A border vertex is laid on the other border where that is at most so many times what some vertex needs.
constexpr float kBorder = 2.0F;

// A convex polygon (convex up to rounding; only its corners are ever measured), relative to some lattice point. Lanes
// up to the next multiple of four repeat its first corner.
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

// dot(n, p) - at for all corners; returns the lowest.
float along(const Polygon& p, const glm::vec3& n, float at, float* out) {
  float low[4] = {kFar, kFar, kFar, kFar};
  for (int b = 0; b < p.size; b += 4)
    for (int i = 0; i < 4; ++i) {
      const float v = n.x * p.x[b + i] + n.y * p.y[b + i] + n.z * p.z[b + i] - at;
      out[b + i] = v;
      low[i] = v < low[i] ? v : low[i];
    }
  return std::min(std::min(low[0], low[1]), std::min(low[2], low[3]));
}

float largest(const Polygon& p, const glm::vec3& n, float at) {
  float high[4] = {0.0F, 0.0F, 0.0F, 0.0F};
  for (int b = 0; b < p.size; b += 4)
    for (int i = 0; i < 4; ++i) {
      const float v = std::abs(n.x * p.x[b + i] + n.y * p.y[b + i] + n.z * p.z[b + i] - at);
      high[i] = v > high[i] ? v : high[i];
    }
  return std::max(std::max(high[0], high[1]), std::max(high[2], high[3]));
}

// Where the edge from an inside corner to an outside one meets the wall.
glm::vec3 crossing(const Polygon& polygon, const float* side, int in, int out) {
  const float share = side[in] / (side[in] - side[out]);
  return polygon.point(in) + share * (polygon.point(out) - polygon.point(in));
}

// Cuts a polygon along a wall that some corner lies beyond. Where rounding left one that crosses the wall more than
// twice, the hulls of both parts still cover it.
void cut(const Polygon& polygon, const float* side, Polygon& inside, Polygon& outside) {
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
    // One run of corners beyond, as it should be.
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

// Where to look for target facets: near which target vertices a source vertex came to lie, and on which facet a
// triangle.
struct Hints {
  std::vector<std::uint32_t> first;  // of vertex v: member[first[v]] … member[first[v + 1] − 1]
  std::vector<std::uint32_t> member;
  std::vector<std::uint32_t> image;  // per source triangle; kNone: it vanished
};

// A piece of a source triangle was laid on a target facet; no point of it is farther from it.
struct Laid {
  std::uint32_t facet = 0;
  float distance = 0.0F;
};

// Where source vertices lie on a target, as Overlay::make() wants it. Nearer facets found later are no part of it: a
// border vertex lies on the facet of its border edge.
struct Placed {
  std::vector<std::uint32_t> facet;
  std::vector<std::uint32_t> twin;
  std::vector<std::uint32_t> border;
  std::vector<Overlay::Gap> gap;
};

// Lays source triangles on a target.
class Layer {
 public:
  Layer(const SurfaceView& source, FacetSurface& target, const Hints& hints, std::vector<std::uint32_t>& facet)
      : source_(source), target_(target), hints_(hints), facet_(facet) {
    facet_.assign(source.positions.size(), kNone);
    is_nearest_.assign(source.positions.size(), 0);
  }

  // Where each vertex lies; returns the largest distance from there, or `known`.
  float place(const FacetSurface& source, const CollapseHistory& history, float known, Placed& placed) {
    const auto& below = target_.view().positions;
    placed.twin.assign(source_.positions.size(), kNone);
    placed.border.assign(source_.positions.size(), kNone);
    placed.gap.assign(source_.positions.size(), {});
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
      if (leaving != kNone && source.leavingBorder(v) != kNone) placeOnBorder(v, kept, known, placed);
    }
    placed.facet = facet_;
    return known;
  }

  float usual() const { return usual_; }

  // The facet nearest to vertex v, or one within `enough`.
  Laid nearest(std::uint32_t v, float enough) {
    const std::uint32_t facet = nearFacet(v, enough);
    return {facet, std::sqrt(target_.facet(facet).distance2(source_.positions[v]))};
  }

  // How far vertex v is from its facet, if that is more than `known`; else that.
  float farther(std::uint32_t v, float known) {
    return std::max(known, std::sqrt(target_.facet(nearFacet(v, known)).distance2(source_.positions[v])));
  }

  // What is that far from its facet or less is near enough; what is no farther than `usual` is not tried again.
  void expect(float enough, float usual) { enough_ = enough, usual_ = usual; }

  // The pieces of source triangle t; together they cover it. What is no farther than `allowed` is not tried again.
  const std::vector<Laid>& lay(std::uint32_t t, float allowed) {
    allowed_ = std::min(allowed, usual_);
    const float enough = enough_;
    enough_ = std::min(enough_, allowed_);
    layOn(t);
    enough_ = enough;
    usual_ = std::max(usual_, best_);
    return kept_;
  }
  // How far the farthest piece of the last triangle is.
  float farthest() const { return best_; }

 private:
  void layOn(std::uint32_t t) {
    const std::uint32_t* c = &source_.indices[3 * std::size_t{t}];
    origin_ = source_.positions[c[0]];
    const glm::vec3 p[3] = {glm::vec3(0.0F), source_.positions[c[1]] - origin_, source_.positions[c[2]] - origin_};
    reach_ = std::max(glm::length(p[1]), glm::length(p[2]));
    const Polygon whole = triangle(p);

    best_ = kFar;
    if (const std::uint32_t image = hints_.image[t]; image != kNone && better(whole, image)) return;
    std::uint32_t near[3];
    for (int k = 0; k < 3; ++k) {
      near[k] = nearFacet(c[k], allowed_);
      if ((k > 0 && near[k] == near[0]) || (k > 1 && near[k] == near[1])) continue;
      if (better(whole, near[k])) return;
    }

    // What the corners need at least.
    float needed = allowed_;
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t nearest = nearFacet(c[k], 0.0F);
      if (nearest != near[k] && better(whole, nearest)) return;
      needed = std::max(needed, std::sqrt(target_.facet(nearest).distance2(source_.positions[c[k]])));
    }
    for (float limit = kRaise * needed + 1e-3F; limit < best_; limit = kRaise * std::max(limit, beyond_)) {
      pieces_.clear(), abort_ = limit, worst_ = 0.0F, walks_ = kMaxWalks, beyond_ = 0.0F;
      if (!quarters(p, c, kMaxQuartering)) continue;
      best_ = worst_, kept_.swap(pieces_);
      break;
    }
  }

  // On the nearer one of the border edges at vertex `kept` of the target, if that is about as near as can be.
  void placeOnBorder(std::uint32_t v, std::uint32_t kept, float near, Placed& placed) {
    const bool has_color = !source_.colors.empty() && !target_.view().colors.empty();
    float nearest = kBorder * near;
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

  // Keeps what a walk from there gives if it is the best so far. True: good enough.
  bool better(const Polygon& whole, std::uint32_t start) {
    pieces_.clear(), abort_ = best_, worst_ = 0.0F, visits_ = kMaxVisits;
    if (walk(whole, start, kNone) && worst_ < best_) best_ = worst_, kept_.swap(pieces_);
    return best_ <= allowed_;
  }

  bool record(std::uint32_t t, const Facet& facet, const Polygon& polygon, float distance) {
    float slack = facet.roughness * (reach_ + facet.longest + glm::length(facet.corner(0) - origin_));
    if (slack > kSlack) {
      distance = exactDistance(polygon, facet);
      slack = 8.0F * kEpsilon * reach_;
    }
    distance = distance * (1.0F + 8.0F * kEpsilon) + slack;
    if (distance >= abort_) return false;
    worst_ = std::max(worst_, distance);
    pieces_.push_back({t, distance});
    return true;
  }

  // The largest distance of its corners, in double: of a polygon, no point is farther from a triangle.
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

  // The largest distance of its corners, or something above `enough` when that is exceeded.
  float distanceOf(const Polygon& polygon, const Facet& facet, float enough) const {
    float worst2 = 0.0F;
    for (int i = 0; i < polygon.size && worst2 <= enough * enough; ++i)
      worst2 = std::max(worst2, facet.distance2(origin_ + polygon.point(i)));
    return std::sqrt(worst2);
  }

  // The same where it is known how far each corner lies inside the walls, and how far off the plane the farthest one.
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

  // Lays a polygon on the target from facet t on. False: some piece is too far from where it came to lie.
  bool walk(const Polygon& polygon, std::uint32_t t, std::uint32_t from) {
    const Facet& facet = target_.facet(t);
    if (facet.flat) return record(t, facet, polygon, distanceOf(polygon, facet, kFar));
    float side[3][Polygon::kMax];
    float at[3];
    float low[3];
    for (int k = 0; k < 3; ++k) {
      at[k] = glm::dot(facet.wall(k), facet.corner(k) - origin_);
      low[k] = along(polygon, facet.wall(k), at[k], side[k]);
    }
    const float plane = glm::dot(facet.normal(), facet.corner(0) - origin_);
    const float height = largest(polygon, facet.normal(), plane);
    const float lowest = std::min({low[0], low[1], low[2]});
    if (lowest >= 0.0F) return record(t, facet, polygon, facet.thin ? distanceOf(polygon, facet, kFar) : height);
    if (height <= enough_ && lowest >= -enough_)
      if (const float d = distanceOf(polygon, facet, side, height); d <= enough_) return record(t, facet, polygon, d);
    if (--visits_ < 0) return record(t, facet, polygon, distanceOf(polygon, facet, abort_));

    // The part beyond each wall walks on; the wall it came over is the last. What is beyond that one alone lies in the
    // wedge over the shared edge, where no neighbour is nearer than the facet.
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
      if (is_cut) low[k] = along(*rest, facet.wall(k), at[k], side[k]);
      if (!(low[k] < 0.0F)) continue;
      if (2 * rest->size > Polygon::kMax) break;
      cut(*rest, side[k], inside[turn], outside);
      const std::uint32_t next = target_.neighbor(t, static_cast<std::size_t>(k));
      const bool goes_on = next != kNone && next != from;
      const float enough = goes_on ? enough_ : abort_;
      const float d = -low[k] <= enough && (!goes_on || height <= enough_) ? distanceOf(outside, facet, enough) : kFar;
      if (d <= enough || !goes_on) {
        if (!record(t, facet, outside, d)) return false;
      } else if (!walk(outside, next, t)) {
        return false;
      }
      if (inside[turn].size == 0) return true;
      is_cut = true;
      rest = &inside[turn];
      turn = 1 - turn;
    }
    const bool over = 2 * rest->size > Polygon::kMax || facet.thin;
    return record(t, facet, *rest, over ? distanceOf(*rest, facet, abort_) : largest(*rest, facet.normal(), plane));
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
    near = target_.search(p, d2, near, enough2);
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
    // Wherever this place is laid, it is not nearer.
    if (d2 > abort_ * abort_) {
      beyond_ = std::sqrt(d2);
      return false;
    }
    if (nearest != near && tryWalk(part, nearest)) return true;
    // Beside an edge that many facets meet at, walks may lead around it; the facet itself may do.
    const Polygon whole = triangle(part);
    const Facet& facet = target_.facet(nearest);
    return record(nearest, facet, whole, distanceOf(whole, facet, abort_));
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
  std::vector<std::uint8_t> is_nearest_;  // of all
  float enough_ = 0.0F;
  float usual_ = 0.0F;
  float allowed_ = 0.0F;
  // Of the triangle at hand.
  glm::vec3 origin_{0.0F};
  float reach_ = 0.0F;
  float best_ = 0.0F;
  std::vector<Laid> kept_;
  // Of the walk at hand.
  std::vector<Laid> pieces_;
  float abort_ = 0.0F;
  float worst_ = 0.0F;
  int visits_ = 0;
  int walks_ = 0;
  float beyond_ = 0.0F;  // some place of the triangle is so far, more than abort_; 0: none is known
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
  hints.first.assign(history.survivor.size() + 1, 0);
  for (const std::uint32_t v : history.survivor) ++hints.first[v + 1];
  for (std::size_t v = 1; v < hints.first.size(); ++v) hints.first[v] += hints.first[v - 1];
  hints.member.resize(history.survivor.size());
  std::vector<std::uint32_t> next(hints.first.begin(), hints.first.end() - 1);
  for (std::uint32_t v = 0; v < history.survivor.size(); ++v) hints.member[next[history.survivor[v]]++] = v;
  hints.image = history.origin;
}

// Bounds of a triangle that rise pair by pair: toward, from, the largest pair, colour.
using Raised = float __attribute__((vector_size(16)));
constexpr Raised kNothing{-kFar, -kFar, -kFar, -kFar};

// What one call needs, kept for the next one of the thread.
struct Scratch {
  FacetSurface after;
  Hints forward;
  Hints backward;
  std::vector<std::uint32_t> facet[2];
  Placed placed;
  std::vector<Raised> had;  // per edge before
  std::vector<Raised> raised;
  Overlay overlay;
};

bool unchanged(const SurfaceView& before, std::uint32_t s, const SurfaceView& after, std::uint32_t t) {
  for (std::size_t k = 0; k < 3; ++k)
    if (before.positions[before.indices[3 * std::size_t{s} + k]] !=
        after.positions[after.indices[3 * std::size_t{t} + k]])
      return false;
  return true;
}

// Of the colours of triangles s and t that lie on each other, corner by corner.
float cornerDifference(const SurfaceView& before, std::uint32_t s, const SurfaceView& after, std::uint32_t t) {
  float largest = 0.0F;
  if (before.colors.empty() || after.colors.empty()) return largest;
  for (std::size_t k = 0; k < 3; ++k)
    largest = std::max(largest, glm::length(before.colors[before.indices[3 * std::size_t{s} + k]] -
                                            after.colors[after.indices[3 * std::size_t{t} + k]]));
  return largest;
}

// Of any colour of triangle s from any of triangle t.
float largestDifference(const SurfaceView& before, std::uint32_t s, const SurfaceView& after, std::uint32_t t) {
  float largest = 0.0F;
  if (before.colors.empty() || after.colors.empty()) return largest;
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t j = 0; j < 3; ++j)
      largest = std::max(largest, glm::length(before.colors[before.indices[3 * std::size_t{s} + k]] -
                                              after.colors[after.indices[3 * std::size_t{t} + j]]));
  return largest;
}

// a + b, not below the sum.
float sum(float a, float b) {
  return a == 0.0F ? b : b == 0.0F ? a : (a + b) * (1.0F + kEpsilon);
}

// Of triangle s, zero when nothing was carried.
float carried(const std::vector<float>& error, std::uint32_t s) {
  return error.empty() ? 0.0F : error[s];
}

// What the vertices before need at least on top of what their triangles carry: how the surfaces were laid on each other
// has no share in it. Triangles that come out farther off are worth a second look.
float neededBelow(const SurfaceView& before, const SurfaceError& error, Layer& forward,
                  const std::vector<Overlay::Gap>& gap) {
  float needed = 0.0F;
  for (std::size_t i = 0; i < before.indices.size(); i += 3) {
    const float toward = carried(error.toward, static_cast<std::uint32_t>(i / 3));
    needed = std::max(needed, toward);
    for (const std::uint32_t v : before.indices.subspan(i, 3)) {
      if (toward + gap[v].distance <= needed) continue;
      needed = std::max(needed, toward + std::min(gap[v].distance, forward.nearest(v, needed - toward).distance));
    }
  }
  return needed;
}

// The same of the vertices after, if that is more than `known`.
float neededAbove(const SurfaceError& error, Overlay& overlay, Layer& backward, float known) {
  const float carries = error.from.empty() ? 0.0F : *std::max_element(error.from.begin(), error.from.end());
  overlay.forEachEnclosed([&](std::uint32_t v, float distance) {
    if (carries + distance <= known) return;
    const Laid near = backward.nearest(v, std::max(known - carries, 0.0F));
    known = std::max(known, carried(error.from, near.facet) + near.distance);
  });
  return known;
}

// Codes are the upper bits of a float, from that of 1/16 on; code 1 is 1/16.
constexpr std::uint32_t kDroppedBits = 12;
constexpr std::uint32_t kMinBits = std::bit_cast<std::uint32_t>(1.0F / 16.0F);
constexpr auto kMaxBits = std::bit_cast<std::uint32_t>(static_cast<float>(1 << 22));
static_assert(((kMaxBits - kMinBits) >> kDroppedBits) + 1 < (1U << 16));

}  // namespace

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

SurfaceError carryError(FacetSurface& surface, const SurfaceError& before_error, const SurfaceView& after,
                        const CollapseHistory& history, float negligible, std::vector<Outlier>& outliers,
                        float precise) {
  thread_local std::unique_ptr<Scratch> kept;
  if (!kept) kept = std::make_unique<Scratch>();
  Scratch& scratch = *kept;
  const SurfaceView& before = surface.view();
  scratch.after.reset(after);
  forwardHints(before, history, scratch.forward);
  backwardHints(history, scratch.backward);
  Layer forward(before, scratch.after, scratch.forward, scratch.facet[0]);
  Layer backward(after, surface, scratch.backward, scratch.facet[1]);
  Placed& placed = scratch.placed;
  float usual = forward.place(surface, history, negligible, placed);
  const float needed = std::max(negligible, neededBelow(before, before_error, forward, placed.gap));
  Overlay& overlay = scratch.overlay;
  overlay.make(surface, scratch.after, placed.facet, placed.gap, placed.twin, placed.border);
  // What the vertices of both need; some of those that the overlay put farther off are nearer to another triangle.
  overlay.forEachEnclosed([&](std::uint32_t v, float distance) {
    if (distance > usual) usual = backward.farther(v, usual);
  });
  usual = std::min(usual, precise);
  const float enough = std::max(negligible, kEnough * usual);
  forward.expect(enough, usual);
  backward.expect(enough, usual);

  const std::size_t triangles = after.indices.size() / 3;
  const std::size_t sources = before.indices.size() / 3;
  SurfaceError result{std::vector<float>(triangles, 0.0F), std::vector<float>(triangles, 0.0F), {}};
  const bool has_color = !before.colors.empty() && !after.colors.empty();
  if (has_color) result.color.assign(triangles, 0.0F);
  const auto raise = [](float& to, float value) { to = std::max(to, value); };
  const auto raiseColor = [&](std::uint32_t t, std::uint32_t s, float difference) {
    if (has_color) raise(result.color[t], sum(carried(before_error.color, s), difference));
  };
  const auto isSame = [&](std::uint32_t s) {
    const std::uint32_t image = scratch.forward.image[s];
    return image != kNone && unchanged(before, s, after, image);
  };

  const float most_needed = neededAbove(before_error, overlay, backward, needed);
  const float most = std::min(most_needed, precise);
  const float far = std::min(kOutlying * most_needed, precise);
  outliers.clear();
  const auto raiseBy = [&](std::uint32_t s, float& to, float value) {
    raise(to, value);
    if (value > far) outliers.push_back({s, value});
  };

  // What an edge before had to carry: the most of its triangles, which share its pairs.
  std::vector<Raised>& had = scratch.had;
  had.assign(surface.edges().size(), kNothing);
  std::vector<Raised>& raised = scratch.raised;
  raised.assign(triangles, Raised{});
  const auto raisePair = [&](const Raised& from, std::uint32_t t, const Overlay::Gap& gap) {
    // Sums as sum() makes them: exact where nothing is added.
    const Raised add{gap.distance, gap.distance, gap.distance, gap.color};
    const Raised exact = from + add;
    const Raised value = add > 0.0F ? exact * (1.0F + kEpsilon) : exact;
    raised[t] = value > raised[t] ? value : raised[t];
  };
  for (std::uint32_t s = 0; s < sources; ++s) {
    const bool is_same = isSame(s);
    const float toward = carried(before_error.toward, s);
    if (is_same) {
      const std::uint32_t image = scratch.forward.image[s];
      raise(result.toward[image], toward);
      raiseColor(image, s, cornerDifference(before, s, after, image));
    }
    const bool is_good = overlay.coversAbove(s);
    bool is_near = is_good && overlay.distance(s) <= forward.usual() && toward + overlay.distance(s) <= most;
    const std::vector<Laid>* pieces = nullptr;
    if (!is_near && !is_same) {
      pieces = &forward.lay(s, std::max(most - toward, 0.0F));
      is_near = is_good && overlay.distance(s) <= forward.farthest();
    }
    if (is_good) {
      const Raised of_s{is_near && !is_same ? toward : -kFar, carried(before_error.from, s), 0.0F,
                        carried(before_error.color, s)};
      overlay.forEachPairWithin(s, [&](std::uint32_t t, const Overlay::Gap& gap) { raisePair(of_s, t, gap); });
      for (std::size_t k = 0; k < 3; ++k) {
        Raised& of_edge = had[surface.edgeOf(s, k)];
        of_edge = of_s > of_edge ? of_s : of_edge;
      }
    }
    if (is_near || is_same) continue;
    for (const Laid& piece : *pieces) {
      raiseBy(s, result.toward[piece.facet], sum(toward, piece.distance));
      raiseColor(piece.facet, s, largestDifference(before, s, after, piece.facet));
    }
  }
  for (std::uint32_t e = 0; e < had.size(); ++e) {
    const Raised of_edge = had[e];
    overlay.forEachPairOfEdge(e, [&](std::uint32_t t, const Overlay::Gap& gap) { raisePair(of_edge, t, gap); });
  }
  for (std::uint32_t t = 0; t < triangles; ++t) {
    raise(result.toward[t], raised[t][0]);
    if (has_color) raise(result.color[t], raised[t][3]);
    if (unchanged(before, history.origin[t], after, t)) {
      result.from[t] = carried(before_error.from, history.origin[t]);
      continue;
    }
    const bool is_good = overlay.coversBelow(t);
    if (is_good && raised[t][2] <= backward.usual() && raised[t][1] <= most) {
      result.from[t] = raised[t][1];
      continue;
    }
    const float allowed = std::max(most - carried(before_error.from, history.origin[t]), 0.0F);
    const std::vector<Laid>& pieces = backward.lay(t, allowed);
    for (const Laid& piece : pieces)
      raiseBy(piece.facet, result.from[t], sum(carried(before_error.from, piece.facet), piece.distance));
    if (is_good && raised[t][1] <= result.from[t]) {
      result.from[t] = raised[t][1];
      continue;
    }
    for (const Laid& piece : pieces) raiseColor(t, piece.facet, largestDifference(before, piece.facet, after, t));
  }
  // Of the pairs.
  for (std::uint32_t s = 0; s < sources; ++s) {
    const float toward = carried(before_error.toward, s);
    const float from = carried(before_error.from, s);
    if (!overlay.coversAbove(s) || std::max(toward, from) + overlay.distance(s) <= far || isSame(s)) continue;
    const auto look = [&](std::uint32_t t, const Overlay::Gap& gap) {
      const float error = std::max(std::min(sum(toward, gap.distance), result.toward[t]),
                                   std::min(sum(from, gap.distance), result.from[t]));
      if (error > far) outliers.push_back({s, error});
    };
    overlay.forEachPairWithin(s, look);
    for (std::size_t k = 0; k < 3; ++k) overlay.forEachPairOfEdge(surface.edgeOf(s, k), look);
  }
  return result;
}

}  // namespace lod::patch::builder
