#include "lod/build/distance_bound.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "lod/build/point_grid.h"

namespace lod::build {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint32_t kUnknown = kNone - 1;
constexpr float kFar = std::numeric_limits<float>::max();
// Most facets that one walk visits; how often a triangle that no walk covers is quartered, and tried again in parts;
// and how many walks all its parts may take.
constexpr int kMaxVisits = 60;
constexpr int kMaxQuartering = 6;
constexpr int kMaxWalks = 400;
// A bound that fails is raised by this factor: how much looser than the distance it may get.
constexpr float kRaise = 1.08F;
// Every so many vertices are measured to learn how large the distance is about.
constexpr std::size_t kSeedStride = 5;

float segmentDistance2(const glm::vec3& p, const glm::vec3& a, const glm::vec3& b) {
  const glm::vec3 ab = b - a;
  const glm::vec3 ap = p - a;
  const float length2 = glm::dot(ab, ab);
  const float t = length2 > 0.0F ? std::clamp(glm::dot(ap, ab) / length2, 0.0F, 1.0F) : 0.0F;
  const glm::vec3 d = ap - t * ab;
  return glm::dot(d, d);
}

// A convex polygon (convex up to rounding; only its corners are ever measured).
struct Polygon {
  static constexpr int kMax = 24;
  int size = 0;
  glm::vec3 point[kMax];
  void add(const glm::vec3& p) { point[size++] = p; }
};

// One triangle with its plane and the three walls: planes through an edge, perpendicular to it, positive inside. What a
// wall says is as many times the distance to it as the edge is long: only its sign and ratios are used.
struct Facet {
  glm::vec3 corner[3];
  glm::vec3 normal{0.0F};
  glm::vec3 wall[3];
  float wall_at[3] = {0.0F, 0.0F, 0.0F};
  float longest2 = 0.0F;                                       // of the edges, squared
  std::uint32_t neighbor[3] = {kUnknown, kUnknown, kUnknown};  // across edge k: corners k, k + 1
  bool made = false;
  bool flat = false;  // has no area: plane and walls mean nothing

  float beyond(int k, const glm::vec3& p) const { return glm::dot(wall[k], p) - wall_at[k]; }
  float height(const glm::vec3& p) const { return glm::dot(normal, p - corner[0]); }

  // Over the triangle: the distance to its plane. Else: to the nearest of the edges that p lies beyond; one of them
  // holds the closest point.
  float distance2(const glm::vec3& p) const {
    float best = kFar;
    bool inside = !flat;
    for (int k = 0; k < 3; ++k) {
      if (!flat && beyond(k, p) >= 0.0F) continue;
      inside = false;
      best = std::min(best, segmentDistance2(p, corner[k], corner[(k + 1) % 3]));
    }
    const float h = inside ? height(p) : 0.0F;
    return inside ? h * h : best;
  }
  bool within(const glm::vec3& p, float limit) const {
    if (flat) return distance2(p) <= limit * limit;
    if (std::abs(height(p)) > limit) return false;
    const float side[3] = {beyond(0, p), beyond(1, p), beyond(2, p)};
    const float lowest = std::min({side[0], side[1], side[2]});
    if (lowest >= 0.0F) return true;
    if (lowest * lowest > limit * limit * longest2) return false;
    for (int k = 0; k < 3; ++k)
      if (side[k] < 0.0F && segmentDistance2(p, corner[k], corner[(k + 1) % 3]) <= limit * limit) return true;
    return false;
  }
  bool within(const Polygon& polygon, float limit) const {
    for (int i = 0; i < polygon.size; ++i)
      if (!within(polygon.point[i], limit)) return false;
    return true;
  }
};

// A surface to measure against: facets, who lies beyond each edge, and the facets around each vertex. Facets are made
// when first asked for: unchanged parts never are.
class Target {
 public:
  explicit Target(const SurfaceView& surface) : surface_(surface), facets_(surface.indices.size() / 3) { makeFans(); }

  const Facet& facet(std::uint32_t t) {
    Facet& f = facets_[t];
    if (!f.made) make(t, f);
    return f;
  }
  std::uint32_t neighbor(std::uint32_t t, int k) {
    std::uint32_t& n = facets_[t].neighbor[k];
    if (n == kUnknown)
      n = across(t, corner(t, static_cast<std::size_t>(k)), corner(t, static_cast<std::size_t>((k + 1) % 3)));
    return n;
  }

  // The facet around vertex v that is nearest to p (or near enough), if nearer than distance2 (which is updated); else
  // `best`.
  std::uint32_t nearestAround(std::uint32_t v, const glm::vec3& p, float& distance2, std::uint32_t best,
                              float enough2 = 0.0F) {
    for (std::uint32_t i = fan_[v]; i < fan_[v + 1] && distance2 > enough2; ++i)
      if (const float d2 = facet(around_[i]).distance2(p); d2 < distance2) best = around_[i], distance2 = d2;
    return best;
  }

  // From a facet on to nearer ones around its corners, while that helps and it is not near enough.
  std::uint32_t descend(std::uint32_t t, const glm::vec3& p, float& distance2, float enough2) {
    for (int step = 0; step < 4 && distance2 > enough2; ++step) {
      std::uint32_t next = t;
      for (std::size_t k = 0; k < 3; ++k) next = nearestAround(corner(t, k), p, distance2, next);
      if (next == t) break;
      t = next;
    }
    return t;
  }

  // A facet near p, found without history.
  std::uint32_t search(const glm::vec3& p, float& distance2) {
    if (!grid_) fillGrid();
    const std::uint32_t v = grid_->nearest(p, [](std::uint32_t) { return true; });
    return nearestAround(v, p, distance2, around_[fan_[v]]);
  }

 private:
  std::uint32_t corner(std::uint32_t t, std::size_t k) const { return surface_.indices[3 * std::size_t{t} + k]; }

  void make(std::uint32_t t, Facet& f) const {
    f.made = true;
    for (std::size_t k = 0; k < 3; ++k) f.corner[k] = surface_.positions[corner(t, k)];
    const glm::vec3 n = glm::cross(f.corner[1] - f.corner[0], f.corner[2] - f.corner[0]);
    const float length = glm::length(n);
    f.flat = !(length > 0.0F);
    if (f.flat) return;
    f.normal = n / length;
    for (int k = 0; k < 3; ++k) {
      const glm::vec3 edge = f.corner[(k + 1) % 3] - f.corner[k];
      f.longest2 = std::max(f.longest2, glm::dot(edge, edge));
      f.wall[k] = glm::cross(f.normal, edge);
      f.wall_at[k] = glm::dot(f.wall[k], f.corner[k]);
    }
  }

  void makeFans() {
    fan_.assign(surface_.positions.size() + 1, 0);
    for (const std::uint32_t v : surface_.indices) ++fan_[v + 1];
    for (std::size_t v = 1; v < fan_.size(); ++v) fan_[v] += fan_[v - 1];
    around_.resize(surface_.indices.size());
    std::vector<std::uint32_t> next(fan_.begin(), fan_.end() - 1);
    for (std::uint32_t t = 0; t < facets_.size(); ++t)
      for (std::size_t k = 0; k < 3; ++k) around_[next[corner(t, k)]++] = t;
  }

  std::uint32_t across(std::uint32_t t, std::uint32_t a, std::uint32_t b) const {
    for (std::uint32_t i = fan_[a]; i < fan_[a + 1]; ++i) {
      const std::uint32_t other = around_[i];
      if (other != t && (corner(other, 0) == b || corner(other, 1) == b || corner(other, 2) == b)) return other;
    }
    return kNone;
  }

  void fillGrid() {
    std::vector<std::uint32_t> used;
    for (std::uint32_t v = 0; v + 1 < fan_.size(); ++v)
      if (fan_[v] != fan_[v + 1]) used.push_back(v);
    grid_.emplace(surface_.positions, used);
  }

  SurfaceView surface_;
  std::vector<Facet> facets_;
  std::vector<std::uint32_t> fan_;
  std::vector<std::uint32_t> around_;
  std::optional<PointGrid> grid_;
};

// How far each corner lies inside a wall. False: all do.
bool crosses(const Polygon& polygon, const Facet& facet, int k, float (&side)[Polygon::kMax]) {
  bool beyond = false;
  for (int i = 0; i < polygon.size; ++i) beyond |= (side[i] = facet.beyond(k, polygon.point[i])) < 0.0F;
  return beyond;
}

// Cuts a polygon where `side` changes its sign; points on the wall go to both sides.
void cut(const Polygon& polygon, const float (&side)[Polygon::kMax], Polygon& inside, Polygon& outside) {
  inside.size = outside.size = 0;
  for (int i = 0; i < polygon.size; ++i) {
    const int j = i + 1 < polygon.size ? i + 1 : 0;
    if (side[i] >= 0.0F) inside.add(polygon.point[i]);
    if (side[i] <= 0.0F) outside.add(polygon.point[i]);
    if (side[i] * side[j] < 0.0F) {
      const float share = side[i] / (side[i] - side[j]);
      const glm::vec3 p = polygon.point[i] + share * (polygon.point[j] - polygon.point[i]);
      inside.add(p);
      outside.add(p);
    }
  }
}

// Lays a polygon on the target from facet t on. True: no point of it is farther from the target than `limit`.
bool covered(Target& target, const Polygon& polygon, std::uint32_t t, std::uint32_t from, float limit, int& visits) {
  const Facet& facet = target.facet(t);
  if (facet.within(polygon, limit)) return true;
  if (--visits < 0 || facet.flat) return false;

  // The part beyond each wall walks on; the wall it came over is the last. What is beyond that one alone lies in the
  // wedge over the shared edge, where no neighbour is nearer than the facet.
  int order[3] = {0, 1, 2};
  for (int k = 0; k < 2; ++k)
    if (from != kNone && target.neighbor(t, order[k]) == from) std::swap(order[k], order[2]);
  const Polygon* rest = &polygon;
  Polygon inside[2];
  Polygon outside;
  float side[Polygon::kMax];
  int turn = 0;
  for (const int k : order) {
    if (!crosses(*rest, facet, k, side)) continue;
    if (2 * rest->size > Polygon::kMax) return false;
    cut(*rest, side, inside[turn], outside);
    if (!facet.within(outside, limit)) {
      const std::uint32_t next = target.neighbor(t, k);
      if (next == kNone || next == from || !covered(target, outside, next, t, limit, visits)) return false;
    }
    if (inside[turn].size == 0) return true;
    rest = &inside[turn];
    turn = 1 - turn;
  }
  return facet.within(*rest, limit);
}

Polygon triangle(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  Polygon p;
  p.add(a), p.add(b), p.add(c);
  return p;
}

// Where to look for target facets: near which target vertices a source vertex came to lie, and on which facet a
// triangle.
struct Hints {
  std::vector<std::uint32_t> first;  // of vertex v: member[first[v]] … member[first[v + 1] − 1]
  std::vector<std::uint32_t> member;
  std::vector<std::uint32_t> image;  // per source triangle; kNone: it vanished
};

// Raises `limit` until it bounds the distance of every source triangle to the target.
class OneSided {
 public:
  OneSided(const SurfaceView& source, Target& target, const Hints& hints)
      : source_(source), target_(target), hints_(hints), facet_(source.positions.size(), kNone) {}

  // Some vertices, to start from a limit that will be needed anyway.
  float seed(float limit) {
    for (std::size_t i = 0; i < source_.indices.size(); i += 3 * kSeedStride) {
      const std::uint32_t v = source_.indices[i];
      limit = std::max(limit, std::sqrt(target_.facet(nearFacet(v, limit)).distance2(source_.positions[v])));
    }
    return limit;
  }

  float bound(float limit) {
    for (std::uint32_t t = 0; 3 * std::size_t{t} < source_.indices.size(); ++t) {
      const std::uint32_t* c = &source_.indices[3 * std::size_t{t}];
      const Polygon whole = triangle(source_.positions[c[0]], source_.positions[c[1]], source_.positions[c[2]]);
      while (!coveredBySome(whole, t, limit)) limit = raised(whole, c, limit);
    }
    return limit;
  }

 private:
  bool coveredBySome(const Polygon& whole, std::uint32_t t, float limit) {
    if (const std::uint32_t image = hints_.image[t]; image != kNone && walk(whole, image, limit)) return true;
    const std::uint32_t* c = &source_.indices[3 * std::size_t{t}];
    for (int k = 0; k < 3; ++k)
      if (walk(whole, nearFacet(c[k], limit), limit)) return true;
    walks_ = kMaxWalks;
    return quartersCovered(whole, c, limit, kMaxQuartering);
  }
  bool walk(const Polygon& polygon, std::uint32_t start, float limit) {
    int visits = kMaxVisits;
    --walks_;
    return covered(target_, polygon, start, kNone, limit, visits);
  }

  // A larger limit: what the triangle's corners need, or a step; never more than the nearest single facet gives.
  float raised(const Polygon& whole, const std::uint32_t* c, float limit) {
    float corners = 0.0F;
    float single = kFar;
    for (int k = 0; k < 3; ++k) {
      const Facet& facet = target_.facet(nearFacet(c[k], 0.0F));
      corners = std::max(corners, std::sqrt(facet.distance2(whole.point[k])));
      float worst = 0.0F;
      for (int i = 0; i < 3; ++i) worst = std::max(worst, std::sqrt(facet.distance2(whole.point[i])));
      single = std::min(single, worst);
    }
    const float step = corners > limit ? corners * 1.0001F : std::max(limit * kRaise, 1e-3F);
    return std::max(std::min(step, single * 1.0001F), std::nextafter(limit, kFar));
  }

  // A facet near a source vertex; looked for until one within `enough` is found.
  std::uint32_t nearFacet(std::uint32_t v, float enough) {
    const glm::vec3& p = source_.positions[v];
    if (facet_[v] == kNone) {
      float d2 = kFar;
      for (std::uint32_t i = hints_.first[v]; i < hints_.first[v + 1]; ++i)
        facet_[v] = target_.nearestAround(hints_.member[i], p, d2, facet_[v], 0.1F * enough * enough);
      if (facet_[v] == kNone) facet_[v] = target_.search(p, d2);
      return facet_[v] = target_.descend(facet_[v], p, d2, enough * enough);
    }
    if (enough > 0.0F) return facet_[v];
    float d2 = target_.facet(facet_[v]).distance2(p);
    return facet_[v] = target_.descend(facet_[v], p, d2, 0.0F);
  }

  bool quartersCovered(const Polygon& whole, const std::uint32_t* c, float limit, int depth) {
    const glm::vec3* p = whole.point;
    const glm::vec3 m[3] = {0.5F * (p[0] + p[1]), 0.5F * (p[1] + p[2]), 0.5F * (p[2] + p[0])};
    for (const Polygon& part : {triangle(p[0], m[0], m[2]), triangle(m[0], p[1], m[1]), triangle(m[2], m[1], p[2]),
                                triangle(m[0], m[1], m[2])})
      if (!quarterCovered(part, c, limit) && (depth <= 1 || walks_ < 0 || !quartersCovered(part, c, limit, depth - 1)))
        return false;
    return true;
  }
  bool quarterCovered(const Polygon& part, const std::uint32_t* c, float limit) {
    const glm::vec3 center = (part.point[0] + part.point[1] + part.point[2]) / 3.0F;
    float d2 = kFar;
    if (walk(part, target_.search(center, d2), limit)) return true;
    for (int k = 0; k < 3; ++k) {
      d2 = target_.facet(facet_[c[k]]).distance2(center);
      if (walk(part, target_.descend(facet_[c[k]], center, d2, 0.0F), limit)) return true;
    }
    return false;
  }

  SurfaceView source_;
  Target& target_;
  const Hints& hints_;
  int walks_ = 0;
  std::vector<std::uint32_t> facet_;  // per source vertex: the nearest facet found so far
};

Hints forwardHints(const SurfaceView& before, const Simplified& history) {
  Hints hints;
  hints.first.resize(history.survivor.size() + 1);
  for (std::uint32_t v = 0; v < hints.first.size(); ++v) hints.first[v] = v;
  hints.member = history.survivor;
  hints.image.assign(before.indices.size() / 3, kNone);
  for (std::uint32_t t = 0; t < history.origin.size(); ++t) hints.image[history.origin[t]] = t;
  return hints;
}

// For each vertex of the simplified mesh, the vertices that were collapsed into it.
Hints backwardHints(const Simplified& history) {
  Hints hints;
  hints.first.assign(history.survivor.size() + 1, 0);
  for (const std::uint32_t v : history.survivor) ++hints.first[v + 1];
  for (std::size_t v = 1; v < hints.first.size(); ++v) hints.first[v] += hints.first[v - 1];
  hints.member.resize(history.survivor.size());
  std::vector<std::uint32_t> next(hints.first.begin(), hints.first.end() - 1);
  for (std::uint32_t v = 0; v < history.survivor.size(); ++v) hints.member[next[history.survivor[v]]++] = v;
  hints.image = history.origin;
  return hints;
}

float largestCoordinate(const SurfaceView& surface) {
  float largest = 0.0F;
  for (const std::uint32_t v : surface.indices) {
    const glm::vec3 p = glm::abs(surface.positions[v]);
    largest = std::max({largest, p.x, p.y, p.z});
  }
  return largest;
}

}  // namespace

float distanceBound(const SurfaceView& before, const SurfaceView& after, const Simplified& history, float negligible) {
  if (before.indices.size() == after.indices.size()) return 0.0F;
  Target before_target(before);
  Target after_target(after);
  const Hints forward_hints = forwardHints(before, history);
  const Hints backward_hints = backwardHints(history);
  OneSided forward(before, after_target, forward_hints);
  OneSided backward(after, before_target, backward_hints);
  float limit = backward.seed(forward.seed(negligible));
  limit = backward.bound(forward.bound(limit));
  // Rounding of the cuts and distances, in units of the last place of the largest coordinate.
  const float slack =
      16.0F * std::numeric_limits<float>::epsilon() * std::max(largestCoordinate(before), largestCoordinate(after));
  return (limit + slack) * (1.0F + 1e-5F);
}

}  // namespace lod::build
