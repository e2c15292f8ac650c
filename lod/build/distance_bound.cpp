#include "lod/build/distance_bound.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>

namespace lod::build {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr float kFar = std::numeric_limits<float>::max();
// Most pieces one source triangle is cut into before what is left is measured whole.
constexpr int kMaxPieces = 48;
// Times a triangle that no walk covers well is quartered and tried again.
constexpr int kMaxQuartering = 3;

float segmentDistance2(const glm::vec3& p, const glm::vec3& a, const glm::vec3& b) {
  const glm::vec3 ab = b - a;
  const glm::vec3 ap = p - a;
  const float length2 = glm::dot(ab, ab);
  const float t = length2 > 0.0F ? std::clamp(glm::dot(ap, ab) / length2, 0.0F, 1.0F) : 0.0F;
  const glm::vec3 d = ap - t * ab;
  return glm::dot(d, d);
}

// One triangle with its plane and the three walls: planes through an edge, perpendicular to it, positive inside.
struct Facet {
  glm::vec3 corner[3];
  glm::vec4 plane{0.0F};
  glm::vec4 wall[3];
  std::uint32_t neighbor[3] = {kNone, kNone, kNone};  // across edge k: corners k, k + 1
  bool flat = false;                                  // has no area: plane and walls mean nothing

  float distance(const glm::vec3& p) const {
    // Over the triangle, its plane; else the nearest of the edges that p lies beyond (one of them holds the closest
    // point).
    float best = kFar;
    bool inside = !flat;
    for (int k = 0; k < 3; ++k) {
      if (!flat && glm::dot(glm::vec3(wall[k]), p - corner[k]) >= 0.0F) continue;
      inside = false;
      best = std::min(best, segmentDistance2(p, corner[k], corner[(k + 1) % 3]));
    }
    return inside ? std::abs(glm::dot(glm::vec3(plane), p - corner[0])) : std::sqrt(best);
  }
};

struct Polygon {
  static constexpr int kMax = 10;
  int size = 0;
  glm::vec3 point[kMax];
  void add(const glm::vec3& p) { point[size++] = p; }
};

float farthest(const Polygon& polygon, const Facet& facet) {
  float worst = 0.0F;
  for (int i = 0; i < polygon.size; ++i) worst = std::max(worst, facet.distance(polygon.point[i]));
  return worst;
}

// A surface to measure against: facets, who lies beyond each edge, and the facets around each vertex.
class Target {
 public:
  explicit Target(const SurfaceView& surface) : surface_(surface) {
    makeFacets();
    makeFans();
    linkNeighbors();
  }

  const Facet& facet(std::uint32_t t) const { return facets_[t]; }
  const SurfaceView& surface() const { return surface_; }
  bool hasFan(std::uint32_t v) const { return fan_[v] != fan_[v + 1]; }

  // The facet around vertex v that is nearest to p; kNone when v has none.
  std::uint32_t nearestAround(std::uint32_t v, const glm::vec3& p, float& distance) const {
    std::uint32_t best = kNone;
    for (std::uint32_t i = fan_[v]; i < fan_[v + 1]; ++i) {
      const float d = facets_[around_[i]].distance(p);
      if (d < distance || best == kNone) best = around_[i], distance = d;
    }
    return best;
  }

  // From a facet on to nearer ones around its corners, while that helps.
  std::uint32_t descend(std::uint32_t t, const glm::vec3& p, float& distance) const {
    for (int step = 0; step < 4; ++step) {
      std::uint32_t next = t;
      for (std::size_t k = 0; k < 3; ++k) {
        float d = distance;
        const std::uint32_t around = nearestAround(surface_.indices[3 * std::size_t{t} + k], p, d);
        if (d < distance) next = around, distance = d;
      }
      if (next == t) break;
      t = next;
    }
    return t;
  }

  // Some vertex with facets near p, by a grid over the vertices: for what has no history.
  std::uint32_t vertexNear(const glm::vec3& p) {
    if (cells_.empty()) fillGrid();
    const glm::ivec3 center = cellOf(p);
    std::uint32_t best = kNone;
    float best2 = kFar;
    for (int ring = 0; ring <= 64; ++ring) {
      forRing(center, ring, [&](const glm::ivec3& c) {
        const auto found = cells_.find(key(c));
        if (found == cells_.end()) return;
        for (const std::uint32_t v : found->second) {
          const glm::vec3 d = surface_.positions[v] - p;
          if (glm::dot(d, d) < best2) best2 = glm::dot(d, d), best = v;
        }
      });
      if (best != kNone) return best;
    }
    return surface_.indices[0];
  }

 private:
  void makeFacets() {
    facets_.resize(surface_.indices.size() / 3);
    for (std::size_t t = 0; t < facets_.size(); ++t) {
      Facet& f = facets_[t];
      for (std::size_t k = 0; k < 3; ++k) f.corner[k] = surface_.positions[surface_.indices[3 * t + k]];
      const glm::vec3 n = glm::cross(f.corner[1] - f.corner[0], f.corner[2] - f.corner[0]);
      const float length = glm::length(n);
      f.flat = !(length > 0.0F);
      if (f.flat) continue;
      f.plane = glm::vec4(n / length, 0.0F);
      for (int k = 0; k < 3; ++k)
        f.wall[k] =
            glm::vec4(glm::cross(glm::vec3(f.plane), glm::normalize(f.corner[(k + 1) % 3] - f.corner[k])), 0.0F);
    }
  }

  void makeFans() {
    fan_.assign(surface_.positions.size() + 1, 0);
    for (const std::uint32_t v : surface_.indices) ++fan_[v + 1];
    for (std::size_t v = 1; v < fan_.size(); ++v) fan_[v] += fan_[v - 1];
    around_.resize(surface_.indices.size());
    std::vector<std::uint32_t> next(fan_.begin(), fan_.end() - 1);
    for (std::uint32_t i = 0; i < surface_.indices.size(); ++i) around_[next[surface_.indices[i]]++] = i / 3;
  }

  void linkNeighbors() {
    for (std::uint32_t t = 0; t < facets_.size(); ++t)
      for (std::size_t k = 0; k < 3; ++k)
        facets_[t].neighbor[k] =
            across(t, surface_.indices[3 * std::size_t{t} + k], surface_.indices[3 * std::size_t{t} + (k + 1) % 3]);
  }
  std::uint32_t across(std::uint32_t t, std::uint32_t a, std::uint32_t b) const {
    for (std::uint32_t i = fan_[a]; i < fan_[a + 1]; ++i) {
      const std::uint32_t* c = &surface_.indices[3 * std::size_t{around_[i]}];
      if (around_[i] != t && (c[0] == b || c[1] == b || c[2] == b)) return around_[i];
    }
    return kNone;
  }

  void fillGrid() {
    glm::vec3 low(kFar);
    glm::vec3 high(-kFar);
    std::size_t used = 0;
    for (std::uint32_t v = 0; v + 1 < fan_.size(); ++v)
      if (hasFan(v)) low = glm::min(low, surface_.positions[v]), high = glm::max(high, surface_.positions[v]), ++used;
    const glm::vec3 size = high - low;
    low_ = low;
    cell_ = std::max(1.0F, 2.0F * std::max({size.x, size.y, size.z}) / std::sqrt(static_cast<float>(used)));
    for (std::uint32_t v = 0; v + 1 < fan_.size(); ++v)
      if (hasFan(v)) cells_[key(cellOf(surface_.positions[v]))].push_back(v);
  }
  glm::ivec3 cellOf(const glm::vec3& p) const { return glm::ivec3(glm::floor((p - low_) / cell_)); }
  static std::uint64_t key(const glm::ivec3& c) {
    auto part = [](int x) { return static_cast<std::uint64_t>(x + (1 << 20)) & 0x1fffff; };
    return part(c.x) | part(c.y) << 21 | part(c.z) << 42;
  }
  template <class Body>
  static void forRing(const glm::ivec3& center, int ring, Body&& body) {
    for (int z = -ring; z <= ring; ++z)
      for (int y = -ring; y <= ring; ++y) {
        const bool face = std::abs(z) == ring || std::abs(y) == ring;
        for (int x = -ring; x <= ring; x += face || ring == 0 ? 1 : 2 * ring) body(center + glm::ivec3(x, y, z));
      }
  }

  SurfaceView surface_;
  std::vector<Facet> facets_;
  std::vector<std::uint32_t> fan_;
  std::vector<std::uint32_t> around_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cells_;
  glm::vec3 low_{0.0F};
  float cell_ = 1.0F;
};

// Cuts a polygon by a plane through `origin`; points on the plane go to both.
void cut(const Polygon& polygon, const glm::vec4& wall, const glm::vec3& origin, Polygon& inside, Polygon& outside) {
  inside.size = outside.size = 0;
  float side[Polygon::kMax];
  for (int i = 0; i < polygon.size; ++i) side[i] = glm::dot(glm::vec3(wall), polygon.point[i] - origin);
  for (int i = 0; i < polygon.size; ++i) {
    const int j = i + 1 < polygon.size ? i + 1 : 0;
    if (side[i] >= 0.0F) inside.add(polygon.point[i]);
    if (side[i] <= 0.0F) outside.add(polygon.point[i]);
    if ((side[i] > 0.0F && side[j] < 0.0F) || (side[i] < 0.0F && side[j] > 0.0F)) {
      const glm::vec3 p = glm::mix(polygon.point[i], polygon.point[j], side[i] / (side[i] - side[j]));
      inside.add(p);
      outside.add(p);
    }
  }
}

// Lays polygons on the target, starting from a facet. `limit`: pieces nearer than this need no closer look.
class Cover {
 public:
  Cover(const Target& target, float limit) : target_(target), limit_(limit) {}

  float measure(const Polygon& polygon, std::uint32_t t, std::uint32_t from) {
    const Facet& facet = target_.facet(t);
    const float whole = farthest(polygon, facet);
    if (whole <= limit_ || --pieces_ < 0 || facet.flat || polygon.size + 3 > Polygon::kMax) return whole;

    // The part beyond each wall walks on; what comes back to where it came from lies in the wedge over the shared edge,
    // where the distance to the facet is the distance to the edge.
    float worst = 0.0F;
    Polygon rest = polygon;
    for (int k = 0; k < 3 && rest.size > 0 && worst < whole; ++k) {
      Polygon inside;
      Polygon outside;
      cut(rest, facet.wall[k], facet.corner[k], inside, outside);
      if (outside.size > 2) {
        const float here = farthest(outside, facet);
        const std::uint32_t next = facet.neighbor[k];
        const bool walk = here > limit_ && next != kNone && next != from;
        worst = std::max(worst, walk ? std::min(here, measure(outside, next, t)) : here);
      }
      rest = inside;
    }
    if (rest.size > 0) worst = std::max(worst, farthest(rest, facet));
    return std::min(whole, worst);
  }

 private:
  const Target& target_;
  float limit_;
  int pieces_ = kMaxPieces;
};

Polygon triangle(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  Polygon p;
  p.add(a), p.add(b), p.add(c);
  return p;
}

// Largest distance from the triangles of a source to a target.
class OneSided {
 public:
  // hints: per source vertex, target vertices near it: hint[first[v]] … hint[first[v + 1] − 1].
  OneSided(const SurfaceView& source, Target& target, std::span<const std::uint32_t> first,
           std::span<const std::uint32_t> hint)
      : source_(source), target_(target), first_(first), hint_(hint), facet_(source.positions.size(), kNone) {}

  // The distances of the vertices alone: a lower bound of the answer, up to the search.
  float seed() {
    float worst = 0.0F;
    std::vector<std::uint8_t> seen(source_.positions.size(), 0);
    for (const std::uint32_t v : source_.indices) {
      if (seen[v]++ != 0) continue;
      float distance = kFar;
      facet_[v] = nearest(source_.positions[v], v, distance);
      worst = std::max(worst, distance);
      seen[v] = 1;
    }
    return worst;
  }

  float bound(float limit) {
    for (std::size_t t = 0; 3 * t < source_.indices.size(); ++t) {
      const std::uint32_t* c = &source_.indices[3 * t];
      const Polygon whole = triangle(source_.positions[c[0]], source_.positions[c[1]], source_.positions[c[2]]);
      float best = kFar;
      for (int k = 0; k < 3 && best > limit; ++k)
        if (k == 0 || (facet_[c[k]] != facet_[c[0]] && (k == 1 || facet_[c[2]] != facet_[c[1]])))
          best = std::min(best, farthest(whole, target_.facet(facet_[c[k]])));
      for (int k = 0; k < 3 && best > limit; ++k)
        best = std::min(best, Cover(target_, limit).measure(whole, facet_[c[k]], kNone));
      if (best > limit) best = std::min(best, quarter(whole, c, limit, kMaxQuartering));
      limit = std::max(limit, best);
    }
    return limit;
  }

 private:
  std::uint32_t nearest(const glm::vec3& p, std::uint32_t v, float& distance) {
    std::uint32_t best = kNone;
    for (std::uint32_t i = first_[v]; i < first_[v + 1]; ++i) {
      float d = kFar;
      const std::uint32_t t = target_.nearestAround(hint_[i], p, d);
      if (t != kNone && d < distance) best = t, distance = d;
    }
    if (best == kNone) best = target_.nearestAround(target_.vertexNear(p), p, distance);
    return distance > 0.0F ? target_.descend(best, p, distance) : best;
  }

  float quarter(const Polygon& whole, const std::uint32_t* corners, float limit, int depth) {
    const glm::vec3* p = whole.point;
    const glm::vec3 m[3] = {0.5F * (p[0] + p[1]), 0.5F * (p[1] + p[2]), 0.5F * (p[2] + p[0])};
    float worst = 0.0F;
    for (const Polygon& part : {triangle(p[0], m[0], m[2]), triangle(m[0], p[1], m[1]), triangle(m[2], m[1], p[2]),
                                triangle(m[0], m[1], m[2])}) {
      const glm::vec3 center = (part.point[0] + part.point[1] + part.point[2]) / 3.0F;
      float best = kFar;
      for (int k = 0; k < 4 && best > limit; ++k) {
        float d = kFar;
        const std::uint32_t start =
            k < 3 ? target_.descend(facet_[corners[k]], center, d = target_.facet(facet_[corners[k]]).distance(center))
                  : target_.nearestAround(target_.vertexNear(center), center, d);
        best = std::min(best, Cover(target_, limit).measure(part, start, kNone));
      }
      if (best > limit && depth > 1) best = std::min(best, quarter(part, corners, limit, depth - 1));
      worst = std::max(worst, best);
    }
    return worst;
  }

  SurfaceView source_;
  Target& target_;
  std::span<const std::uint32_t> first_;
  std::span<const std::uint32_t> hint_;
  std::vector<std::uint32_t> facet_;  // per source vertex: the nearest facet found
};

// For each vertex of `after`, the vertices of `before` that were collapsed into it, itself first.
void invert(std::span<const std::uint32_t> survivor, std::vector<std::uint32_t>& first,
            std::vector<std::uint32_t>& members) {
  first.assign(survivor.size() + 1, 0);
  for (const std::uint32_t v : survivor) ++first[v + 1];
  for (std::size_t v = 1; v < first.size(); ++v) first[v] += first[v - 1];
  members.resize(survivor.size());
  std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
  for (std::uint32_t v = 0; v < survivor.size(); ++v) members[next[survivor[v]]++] = v;
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

float distanceBound(const SurfaceView& before, const SurfaceView& after, std::span<const std::uint32_t> survivor) {
  Target before_target(before);
  Target after_target(after);
  std::vector<std::uint32_t> one_each(survivor.size() + 1);
  for (std::uint32_t v = 0; v < one_each.size(); ++v) one_each[v] = v;
  std::vector<std::uint32_t> first;
  std::vector<std::uint32_t> members;
  invert(survivor, first, members);
  OneSided forward(before, after_target, one_each, survivor);
  OneSided backward(after, before_target, first, members);

  // What the vertices say is reached anyway: no triangle below that needs a closer look.
  float bound = std::max(forward.seed(), backward.seed());
  if (bound > 0.0F || before.indices.size() != after.indices.size()) bound = backward.bound(forward.bound(bound));
  // Rounding of the cuts and distances, in units of the last place of the largest coordinate.
  const float slack =
      16.0F * std::numeric_limits<float>::epsilon() * std::max(largestCoordinate(before), largestCoordinate(after));
  return bound > 0.0F ? (bound + slack) * (1.0F + 1e-5F) : 0.0F;
}

}  // namespace lod::build
