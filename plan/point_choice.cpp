#include "plan/point_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "plan/greedy_choice.h"
#include "repository/sampling/cube_face.h"

namespace plan {
namespace {

constexpr std::size_t kMaxCandidates = 256;  // computing 256 × 144 uses takes 0.2 ms
// The next three are choices. A larger kSightClearance lets points see through thin walls, a smaller one lets the
// proxy's error hide the surface itself.
constexpr float kSightClearance = 0.5F;     // share of the stated error, which is an upper bound
constexpr float kCellShare = 1.0F / 16.0F;  // radians: about one tile of the samples' picture
constexpr float kNarrowCone = 0.5F;         // cosine of 60°: with normals so close a patch is nearly a plane
// A cut of leaves errs by nothing, and then the place that a ray meets, rounded, would lie behind its own triangle as
// often as before it. Share of the proxy's diagonal; a float has seven digits.
constexpr float kRounding = 1e-5F;
/// A model within so much of the picture is looked at by itself. A choice: at least twice as many rays meet it then.
constexpr float kSmallShare = 0.5F;

using Index = std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>;
Index orderOf(const glm::uvec3& p) {
  return {p.x, p.y, p.z};
}

// ---- the visible surface ----

struct Ray {
  glm::vec3 origin;
  glm::vec3 direction;  // unit length
};

/// The part of a ray that a section leaves, by distance.
struct Kept {
  float from = 0.0F, to = std::numeric_limits<float>::max();
};
Kept keptOf(const Ray& ray, const glm::vec4& section) {
  const float climb = glm::dot(glm::vec3(section), ray.direction);
  const float below = section.w - glm::dot(glm::vec3(section), ray.origin);
  Kept kept;
  if (climb > 0.0F) kept.to = std::max(0.0F, below / climb);
  if (climb < 0.0F) kept.from = std::max(0.0F, below / climb);
  if (climb == 0.0F && below < 0.0F) kept.to = 0.0F;
  return kept;
}

Ray rayThrough(const base::Camera& camera, float ndc_x, float ndc_y) {
  const glm::mat4& p = camera.clip_from_eye;
  const glm::vec3 eye_direction((ndc_x + p[2][0]) / p[0][0], (ndc_y + p[2][1]) / p[1][1], -1.0F);
  return {camera.eye, glm::normalize(glm::transpose(glm::mat3(camera.eye_from_scene)) * eye_direction)};
}

/// The distances between which the ray is inside the box, in front of its origin.
std::optional<std::pair<float, float>> intersectBox(const Ray& ray, const base::Aabb& box) {
  float enter = 0.0F;
  float leave = std::numeric_limits<float>::max();
  for (int axis = 0; axis < 3; ++axis) {
    const float direction = std::abs(ray.direction[axis]) < 1e-12F ? 1e-12F : ray.direction[axis];
    const float a = (box.min[axis] - ray.origin[axis]) / direction;
    const float b = (box.max[axis] - ray.origin[axis]) / direction;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  if (enter > leave) return std::nullopt;
  return std::pair{enter, leave};
}

/// The distance along the ray at which it probably meets the patch's surface.
std::optional<float> intersectPatch(const Ray& ray, const lod::patch::Patch& patch) {
  const auto inside = intersectBox(ray, patch.box);
  if (!inside) return std::nullopt;
  const auto [enter, leave] = *inside;
  if (patch.cone.cos_angle < kNarrowCone) return 0.5F * (enter + leave);

  const float slope = glm::dot(ray.direction, patch.cone.axis);
  if (std::abs(slope) < 1e-3F) return 0.5F * (enter + leave);
  const float distance = glm::dot(patch.box.center() - ray.origin, patch.cone.axis) / slope;
  const float margin = 0.05F * patch.bounds.radius;
  if (distance <= 0.0F || distance < enter - margin || distance > leave + margin) return std::nullopt;
  return distance;
}

using SurfaceHit = lod::patch::ProxySight::Intersection;

/// A part of the picture, 0..1 from its lower left.
struct Window {
  float left = 0.0F, bottom = 0.0F, width = 1.0F, height = 1.0F;
};

/// Sends one ray through the middle of each tile of the window, row by row from the lower left, from where the
/// camera's section leaves something. `intersect` returns the hit of a ray, if any. Backs that a section exposes have
/// one colour, of which no image tells. `hits` gets the numbers of the tiles of which there are samples.
template <class Intersect>
std::vector<SurfaceSample> sampleWindow(const base::Camera& camera, const Window& window, int columns, int rows,
                                        const Intersect& intersect, std::vector<int>& hits) {
  std::vector<SurfaceSample> samples;
  hits.clear();
  samples.reserve(static_cast<std::size_t>(columns * rows));
  const float weight = window.width * window.height / static_cast<float>(columns * rows);
  for (int tile = 0; tile < columns * rows; ++tile) {
    const float x = (static_cast<float>(tile % columns) + 0.5F) / static_cast<float>(columns);
    const float y = (static_cast<float>(tile / columns) + 0.5F) / static_cast<float>(rows);
    Ray ray = rayThrough(camera, 2.0F * (window.left + window.width * x) - 1.0F,
                         2.0F * (window.bottom + window.height * y) - 1.0F);
    const Kept kept = keptOf(ray, camera.section);
    if (!std::isfinite(kept.from)) continue;  // along the section's plane, beyond it
    ray.origin += kept.from * ray.direction;
    const std::optional<SurfaceHit> hit = intersect(ray);
    if (!hit || hit->distance > kept.to - kept.from) continue;
    const bool is_exposed = kept.from > 0.0F && glm::dot(hit->normal, ray.direction) > 0.0F;
    if (is_exposed) continue;
    samples.push_back({ray.origin + hit->distance * ray.direction, hit->normal, weight, hit->cell});
    hits.push_back(tile);
  }
  return samples;
}

/// The part of the picture in which a box lies; all of it where a corner is behind the eye, or all of the box beside.
Window windowOf(const base::Camera& camera, const base::Aabb& box) {
  if (box.empty() || camera.orthographic()) return {};
  const glm::mat4 clip_from_scene = camera.clipFromScene();
  glm::vec2 least(1.0F), most(0.0F);
  for (int i = 0; i < 8; ++i) {
    const glm::vec4 corner = clip_from_scene * glm::vec4(box.corner(i), 1.0F);
    if (corner.w <= 0.0F) return {};
    const glm::vec2 at = 0.5F * glm::vec2(corner) / corner.w + 0.5F;
    least = glm::min(least, at), most = glm::max(most, at);
  }
  least = glm::clamp(least, 0.0F, 1.0F), most = glm::clamp(most, 0.0F, 1.0F);
  if (least.x >= most.x || least.y >= most.y) return {};
  return {least.x, least.y, most.x - least.x, most.y - least.y};
}

/// The part of a window in which these of its tiles lie, and one tile more on each side.
Window windowAround(const Window& all, const std::vector<int>& tiles, int columns, int rows) {
  int left = columns, right = -1;
  for (const int tile : tiles) left = std::min(left, tile % columns), right = std::max(right, tile % columns);
  left = std::max(0, left - 1), right = std::min(columns - 1, right + 1);
  const int bottom = std::max(0, tiles.front() / columns - 1), top = std::min(rows - 1, tiles.back() / columns + 1);
  const float width = all.width / static_cast<float>(columns), height = all.height / static_cast<float>(rows);
  return {all.left + width * static_cast<float>(left), all.bottom + height * static_cast<float>(bottom),
          width * static_cast<float>(right + 1 - left), height * static_cast<float>(top + 1 - bottom)};
}

/// Samples the part of the picture that shows the model: of a flat site that is seen from aside one ray in thirty
/// through all of the picture meets anything, or none does.
template <class Intersect>
std::vector<SurfaceSample> sampleModel(const base::Camera& camera, const base::Aabb& box, int columns, int rows,
                                       const Intersect& intersect) {
  Window window = windowOf(camera, box);
  if (window.width * window.height > kSmallShare) window = {};
  std::vector<int> hits;
  std::vector<SurfaceSample> samples = sampleWindow(camera, window, columns, rows, intersect, hits);
  if (samples.empty()) return samples;
  const Window narrow = windowAround(window, hits, columns, rows);
  if (narrow.width * narrow.height > kSmallShare * window.width * window.height) return samples;
  return sampleWindow(camera, narrow, columns, rows, intersect, hits);
}

// ---- samples ----

/// Sums of floats depend on their order. Sorting makes the answer independent of the order in which samples came.
void sortSamples(std::vector<SurfaceSample>& samples) {
  auto key = [](const SurfaceSample& s) {
    return std::tuple(s.position.x, s.position.y, s.position.z, s.normal.x, s.normal.y, s.normal.z, s.weight);
  };
  std::sort(samples.begin(), samples.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
}

// ---- candidates ----

/// The sampling points at the corners of a cell, each once.
class CellCorners {
 public:
  CellCorners(const PointQuery& query, const glm::vec3& place) {
    if (query.tree == nullptr) {
      points_ = query.grid.cellCorners(place);
      count_ = points_.size();
      return;
    }
    // Where the grid ends within a cell some corners coincide.
    for (const glm::uvec3& p : query.tree->cornersOf(query.tree->leafAt(query.grid, place)))
      if (!query.tree->leavesOut(p) && std::find(begin(), end(), p) == end()) points_[count_++] = p;
  }
  const glm::uvec3* begin() const { return points_.data(); }
  const glm::uvec3* end() const { return points_.data() + count_; }

 private:
  std::array<glm::uvec3, 8> points_;
  std::size_t count_ = 0;
};

/// The corners of the eye's cell, nearest first.
std::vector<glm::uvec3> cornersByDistance(const PointQuery& query) {
  const CellCorners corners(query, query.eye);
  std::vector<glm::uvec3> sorted(corners.begin(), corners.end());
  auto distance = [&](const glm::uvec3& p) { return glm::length(query.grid.point(p.x, p.y, p.z) - query.eye); };
  std::sort(sorted.begin(), sorted.end(), [&](const glm::uvec3& a, const glm::uvec3& b) {
    return std::tuple(distance(a), orderOf(a)) < std::tuple(distance(b), orderOf(b));
  });
  return sorted;
}

/// Sums by point: a table of open places, of which at most half are taken.
class PointScores {
 public:
  struct Entry {
    glm::uvec3 point{0};
    float score = 0.0F;
  };
  PointScores() : places_(std::size_t{1} << kFirstBits, kFree), shift_(64 - kFirstBits) {}

  void add(const glm::uvec3& point, float score) {
    std::uint32_t& place = placeOf(point);
    if (place == kFree) {
      place = static_cast<std::uint32_t>(entries_.size());
      entries_.push_back({point, 0.0F});
    }
    entries_[place].score += score;
    if (2 * entries_.size() > places_.size()) grow();
  }
  std::vector<Entry>& entries() { return entries_; }  ///< in the order in which their points came

 private:
  static constexpr unsigned kFirstBits = 10;
  static constexpr std::uint32_t kFree = ~0U;

  std::uint32_t& placeOf(const glm::uvec3& point) {
    const std::uint64_t key = point.x | std::uint64_t{point.y} << 16 | std::uint64_t{point.z} << 32;
    std::size_t at = key * 0x9E3779B97F4A7C15U >> shift_;  // Knuth's multiplicative hashing
    while (places_[at] != kFree && entries_[places_[at]].point != point) at = (at + 1) & (places_.size() - 1);
    return places_[at];
  }
  void grow() {
    --shift_;
    places_.assign(2 * places_.size(), kFree);
    for (std::uint32_t i = 0; i < entries_.size(); ++i) placeOf(entries_[i].point) = i;
  }

  std::vector<Entry> entries_;
  std::vector<std::uint32_t> places_;  // of entries
  unsigned shift_;
};

/// Ranks the corners of cells at four places on each line from the eye, or where the section ends, to a sample: there,
/// where a face is as fine as the view, and half-way before and behind that. A point scores for each place the more,
/// the nearer it lies. The best `count` are returned.
std::vector<glm::uvec3> pointsTowardsSurface(const PointQuery& query, const std::vector<SurfaceSample>& samples,
                                             std::size_t count) {
  const float focal_face = 0.5F * static_cast<float>(query.grid.face_size);
  const float even = 1.0F - std::min(1.0F, focal_face / query.pixels_per_unit_at_one);
  const std::array<float, 4> fractions{0.0F, 0.5F * even, even, 0.5F * (1.0F + even)};

  PointScores scores;
  for (const SurfaceSample& sample : samples) {
    const glm::vec3 way = sample.position - query.eye;
    const float length = std::max(glm::length(way), 1e-20F);
    const float cut_away = std::min(1.0F, keptOf({query.eye, way / length}, query.section).from / length);
    for (float fraction : fractions) {
      const glm::vec3 place = query.eye + glm::mix(cut_away, 1.0F, fraction) * way;
      for (const glm::uvec3& p : CellCorners(query, place)) {
        const float distance = glm::length(query.grid.point(p.x, p.y, p.z) - place) / query.grid.spacing;
        scores.add(p, sample.weight / (1.0F + distance * distance));
      }
    }
  }

  std::vector<PointScores::Entry>& ranked = scores.entries();
  count = std::min(count, ranked.size());
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(count), ranked.end(),
                    [](const PointScores::Entry& a, const PointScores::Entry& b) {
                      return a.score != b.score ? a.score > b.score : orderOf(a.point) < orderOf(b.point);
                    });
  std::vector<glm::uvec3> points(count);
  for (std::size_t i = 0; i < count; ++i) points[i] = ranked[i].point;
  return points;
}

}  // namespace

std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::Hierarchy& hierarchy,
                                                std::span<const std::uint32_t> patches, const base::Camera& camera,
                                                int columns, int rows) {
  base::Aabb box;
  for (const std::uint32_t index : patches) box.add(hierarchy.patches[index].box);
  return sampleModel(camera, box, columns, rows, [&](const Ray& ray) -> std::optional<SurfaceHit> {
    const lod::patch::Patch* nearest = nullptr;
    float nearest_distance = std::numeric_limits<float>::max();
    for (std::uint32_t index : patches) {
      const auto distance = intersectPatch(ray, hierarchy.patches[index]);
      if (distance && *distance < nearest_distance) nearest = &hierarchy.patches[index], nearest_distance = *distance;
    }
    if (nearest == nullptr) return std::nullopt;
    const bool narrow = nearest->cone.cos_angle >= kNarrowCone;
    return SurfaceHit{nearest_distance, narrow ? nearest->cone.axis : glm::vec3(0.0F), SurfaceSample::kNoCell};
  });
}

std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::ProxySight& sight, const base::Camera& camera,
                                                int columns, int rows) {
  return sampleModel(camera, sight.box(), columns, rows, [&](const Ray& ray) {
    return sight.nearest(ray.origin, ray.direction, std::numeric_limits<float>::max());
  });
}

bool isInSight(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample) {
  return query.sight == nullptr || !query.sight->isBlocked(sample.position, point, sightClearance(*query.sight));
}

float sightClearance(const lod::patch::ProxySight& sight) {
  return std::max(kSightClearance * sight.error(), kRounding * sight.diagonal());
}

SightOfPoint::SightOfPoint(const PointQuery& query, const glm::uvec3& point)
    : query_(query), place_(query.grid.point(point.x, point.y, point.z)) {
  if (query.sight != nullptr && query.sight_cache != nullptr) row_ = query.sight_cache->rowOf(point);
}

bool SightOfPoint::sees(const SurfaceSample& sample) const {
  if (row_ == nullptr || sample.cell == SurfaceSample::kNoCell) return isInSight(query_, place_, sample);
  const glm::vec3 to_eye = query_.eye - sample.position;
  const glm::vec3 to_point = place_ - sample.position;
  const float reach = query_.sight->cell(sample.cell).radius / kCellShare;
  if (reach * reach > std::min(glm::dot(to_eye, to_eye), glm::dot(to_point, to_point)))
    return isInSight(query_, place_, sample);
  return query_.sight_cache->sees(*row_, place_, sample.cell);
}

std::vector<glm::uvec3> choosePoints(const PointQuery& query, std::vector<SurfaceSample> samples) {
  std::vector<glm::uvec3> points;
  for (const ChosenPoint& chosen : choosePointsWithGains(query, std::move(samples))) points.push_back(chosen.point);
  return points;
}

std::vector<ChosenPoint> choosePointsWithGains(const PointQuery& query, std::vector<SurfaceSample> samples) {
  if (query.grid.pointCount() == 0 || query.max_points == 0 || samples.empty()) return {};
  sortSamples(samples);

  // The candidates are the corners of the eye's cell and then the most promising other points.
  std::vector<glm::uvec3> candidates = cornersByDistance(query);
  const std::size_t corner_count = candidates.size();
  for (const glm::uvec3& point : pointsTowardsSurface(query, samples, kMaxCandidates)) {
    if (candidates.size() >= kMaxCandidates) break;
    const auto end = candidates.begin() + static_cast<std::ptrdiff_t>(corner_count);
    if (std::find(candidates.begin(), end, point) == end) candidates.push_back(point);
  }
  UseTable uses = usesOfPoints(query, candidates, samples);
  std::vector<std::optional<SightOfPoint>> sights(candidates.size());
  const IsShown is_shown = [&](std::size_t c, std::size_t s) {
    if (!sights[c]) sights[c].emplace(query, candidates[c]);
    return sights[c]->sees(samples[s]);
  };
  std::vector<ChosenPoint> chosen;
  for (const ChosenItem& item : chooseGreedily(uses, samples, is_shown, query.max_points))
    if (uses.isOfUse(item.item)) chosen.push_back({candidates[item.item], item.gain});
  return chosen;
}

std::vector<repository::FaceKey> orderFaces(const PointQuery& query, std::span<const glm::uvec3> points,
                                            std::vector<SurfaceSample> samples) {
  sortSamples(samples);

  // A face has its point's uses for the samples that lie in it.
  const UseTable of_points = usesOfPoints(query, points, samples);
  constexpr std::size_t kFaces = 6;
  UseTable of_faces(kFaces * points.size(), samples.size());
  for (std::size_t p = 0; p < points.size(); ++p) {
    const glm::vec3 point = query.grid.point(points[p].x, points[p].y, points[p].z);
    const SightOfPoint sight(query, points[p]);
    for (std::size_t s = 0; s < samples.size(); ++s) {
      const glm::vec3 direction = samples[s].position - point;
      if (of_points.at(p, s) > 0.0F && sight.sees(samples[s]))
        of_faces.set(kFaces * p + repository::faceOfDirection(direction), s, of_points.at(p, s));
    }
  }

  std::vector<repository::FaceKey> ordered;
  for (const ChosenItem& chosen : chooseGreedily(of_faces, samples, nullptr, of_faces.items())) {
    const glm::uvec3& point = points[chosen.item / kFaces];
    if (of_faces.isOfUse(chosen.item))
      ordered.push_back({point.x, point.y, point.z, static_cast<std::uint32_t>(chosen.item % kFaces)});
  }
  return ordered;
}

}  // namespace plan
