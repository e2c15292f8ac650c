#include "plan/point_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "repository/sampling/cube_face.h"

namespace plan {
namespace {

constexpr std::size_t kMaxCandidates = 256;  // computing 256 × 144 uses takes less than a millisecond
// The next four are choices. A larger kSecondBest prefers points that show places twice; a larger kSightClearance lets
// points see through thin walls, a smaller one lets the proxy's error hide the surface itself.
constexpr float kSecondBest = 0.5F;      // weight of the second image of a place, as in the header's formula
constexpr float kSightClearance = 0.5F;  // share of the stated error, which is an upper bound
constexpr float kNarrowCone = 0.5F;      // cosine of 60°: with normals so close a patch is nearly a plane
constexpr float kGrazing = 0.2F;         // cosine below which the ratio of the two facings is dominated by noise

using Index = std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>;
Index orderOf(const glm::uvec3& p) {
  return {p.x, p.y, p.z};
}

// ---- the visible surface ----

struct Ray {
  glm::vec3 origin;
  glm::vec3 direction;  // unit length
};

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

/// Sends one ray through the middle of each tile of the picture, row by row from the lower left. `intersect` returns
/// the hit of a ray, if any.
template <class Intersect>
std::vector<SurfaceSample> sampleTiles(const base::Camera& camera, int columns, int rows, const Intersect& intersect) {
  std::vector<SurfaceSample> samples;
  const float weight = 1.0F / static_cast<float>(columns * rows);
  for (int tile = 0; tile < columns * rows; ++tile) {
    const float x = (static_cast<float>(tile % columns) + 0.5F) / static_cast<float>(columns);
    const float y = (static_cast<float>(tile / columns) + 0.5F) / static_cast<float>(rows);
    const Ray ray = rayThrough(camera, 2.0F * x - 1.0F, 2.0F * y - 1.0F);
    const std::optional<SurfaceHit> hit = intersect(ray);
    if (hit) samples.push_back({ray.origin + hit->distance * ray.direction, hit->normal, weight});
  }
  return samples;
}

// ---- the worth of a set of points ----

/// The best and second best use of a sample so far.
struct SampleWorth {
  float best = 0.0F, second = 0.0F;

  float gain(float use) const {
    if (use > best) return (use - best) + kSecondBest * (best - second);
    return use > second ? kSecondBest * (use - second) : 0.0F;
  }
  void add(float use) {
    if (use > best) {
      second = std::exchange(best, use);
    } else {
      second = std::max(second, use);
    }
  }
};

/// The state of a greedy choice. uses[i] holds the use of item i for every sample, and `remove_hidden(i)` zeroes those
/// that something hides. That test takes most of the time and can only lower an item's gain, so it runs only when the
/// item would be chosen next.
struct GreedyChoice {
  std::vector<std::vector<float>>& uses;
  const std::vector<SurfaceSample>& samples;
  std::function<void(std::size_t item)> remove_hidden;
  std::vector<SampleWorth> worths = std::vector<SampleWorth>(samples.size());
  std::vector<char> is_tested = std::vector<char>(uses.size(), 0);  // one an item: remove_hidden has run

  float gainOf(std::size_t item) const {
    float sum = 0.0F;
    for (std::size_t s = 0; s < samples.size(); ++s) sum += samples[s].weight * worths[s].gain(uses[item][s]);
    return sum;
  }
  void testOnce(std::size_t item) {
    if (is_tested[item] == 0) remove_hidden(item);
    is_tested[item] = 1;
  }
  void addItem(std::size_t item) {
    testOnce(item);
    for (std::size_t s = 0; s < samples.size(); ++s) worths[s].add(uses[item][s]);
  }
  /// The index into `items` of the one that adds most; of equal ones the first.
  std::size_t bestOf(const std::vector<std::size_t>& items) {
    std::vector<float> gains;
    for (const std::size_t item : items) gains.push_back(gainOf(item));
    for (;;) {
      const auto best = static_cast<std::size_t>(std::max_element(gains.begin(), gains.end()) - gains.begin());
      if (is_tested[items[best]] != 0) return best;
      testOnce(items[best]);
      gains[best] = gainOf(items[best]);
    }
  }
};

struct ChosenItem {
  std::size_t item = 0;
  float gain = 0.0F;
};

/// Chooses up to `limit` items in greedy order.
std::vector<ChosenItem> chooseGreedily(GreedyChoice& choice, std::vector<std::size_t> items, std::size_t limit) {
  std::vector<ChosenItem> chosen;
  while (!items.empty() && chosen.size() < limit) {
    const std::size_t at = choice.bestOf(items);
    chosen.push_back({items[at], choice.gainOf(items[at])});
    choice.addItem(items[at]);
    items.erase(items.begin() + static_cast<std::ptrdiff_t>(at));
  }
  return chosen;
}

std::vector<std::size_t> indicesBelow(std::size_t count) {
  std::vector<std::size_t> items(count);
  std::iota(items.begin(), items.end(), std::size_t{0});
  return items;
}

bool isOfUse(const std::vector<float>& uses) {
  return std::any_of(uses.begin(), uses.end(), [](float use) { return use > 0.0F; });
}

/// Zeroes the uses of samples that something hides from the point.
void zeroHidden(const PointQuery& query, const glm::uvec3& point, const std::vector<SurfaceSample>& samples,
                std::vector<float>& uses) {
  const glm::vec3 place = query.grid.point(point.x, point.y, point.z);
  for (std::size_t s = 0; s < samples.size(); ++s)
    if (uses[s] > 0.0F && !isInSight(query, place, samples[s])) uses[s] = 0.0F;
}

/// Sums of floats depend on their order. Sorting makes the answer independent of the order in which samples came.
void sortSamples(std::vector<SurfaceSample>& samples) {
  auto key = [](const SurfaceSample& s) {
    return std::tuple(s.position.x, s.position.y, s.position.z, s.normal.x, s.normal.y, s.normal.z, s.weight);
  };
  std::sort(samples.begin(), samples.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
}

// ---- candidates ----

/// The sampling points at the corners of the cell that holds a place.
std::vector<glm::uvec3> cornersAround(const PointQuery& query, const glm::vec3& place) {
  if (query.tree == nullptr) {
    const auto corners = query.grid.cellCorners(place);
    return {corners.begin(), corners.end()};
  }
  // Where the grid ends within a cell some corners coincide.
  std::vector<glm::uvec3> points;
  for (const glm::uvec3& p : query.tree->cornersOf(query.tree->leafAt(query.grid, place)))
    if (!query.tree->leavesOut(p) && std::find(points.begin(), points.end(), p) == points.end()) points.push_back(p);
  return points;
}

/// The corners of the eye's cell, nearest first.
std::vector<glm::uvec3> cornersByDistance(const PointQuery& query) {
  std::vector<glm::uvec3> sorted = cornersAround(query, query.eye);
  auto distance = [&](const glm::uvec3& p) { return glm::length(query.grid.point(p.x, p.y, p.z) - query.eye); };
  std::sort(sorted.begin(), sorted.end(), [&](const glm::uvec3& a, const glm::uvec3& b) {
    return std::tuple(distance(a), orderOf(a)) < std::tuple(distance(b), orderOf(b));
  });
  return sorted;
}

/// Ranks the corners of cells at four places on each line from the eye to a sample: at the eye, where a face is as fine
/// as the view, and half-way before and behind that. A point scores for each place the more, the nearer it lies.
std::vector<glm::uvec3> pointsTowardsSurface(const PointQuery& query, const std::vector<SurfaceSample>& samples) {
  const float focal_face = 0.5F * static_cast<float>(query.grid.face_size);
  const float even = 1.0F - std::min(1.0F, focal_face / query.pixels_per_unit_at_one);
  const std::array<float, 4> fractions{0.0F, 0.5F * even, even, 0.5F * (1.0F + even)};

  std::unordered_map<std::uint64_t, std::pair<glm::uvec3, float>> scores;
  for (const SurfaceSample& sample : samples) {
    for (float fraction : fractions) {
      const glm::vec3 place = glm::mix(query.eye, sample.position, fraction);
      for (const glm::uvec3& p : cornersAround(query, place)) {
        const float distance = glm::length(query.grid.point(p.x, p.y, p.z) - place) / query.grid.spacing;
        const std::uint64_t key = repository::codeOfPoint(p);
        auto& entry = scores.try_emplace(key, p, 0.0F).first->second;
        entry.second += sample.weight / (1.0F + distance * distance);
      }
    }
  }

  std::vector<std::pair<glm::uvec3, float>> ranked;
  ranked.reserve(scores.size());
  for (const auto& [key, entry] : scores) ranked.push_back(entry);
  std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
    return a.second != b.second ? a.second > b.second : orderOf(a.first) < orderOf(b.first);
  });
  std::vector<glm::uvec3> points;
  for (const auto& [point, score] : ranked) points.push_back(point);
  return points;
}

}  // namespace

std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::Hierarchy& hierarchy,
                                                std::span<const std::uint32_t> patches, const base::Camera& camera,
                                                int columns, int rows) {
  return sampleTiles(camera, columns, rows, [&](const Ray& ray) -> std::optional<SurfaceHit> {
    const lod::patch::Patch* nearest = nullptr;
    float nearest_distance = std::numeric_limits<float>::max();
    for (std::uint32_t index : patches) {
      const auto distance = intersectPatch(ray, hierarchy.patches[index]);
      if (distance && *distance < nearest_distance) nearest = &hierarchy.patches[index], nearest_distance = *distance;
    }
    if (nearest == nullptr) return std::nullopt;
    const bool narrow = nearest->cone.cos_angle >= kNarrowCone;
    return SurfaceHit{nearest_distance, narrow ? nearest->cone.axis : glm::vec3(0.0F)};
  });
}

std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::ProxySight& sight, const base::Camera& camera,
                                                int columns, int rows) {
  return sampleTiles(camera, columns, rows, [&](const Ray& ray) {
    return sight.nearest(ray.origin, ray.direction, std::numeric_limits<float>::max());
  });
}

bool isInSight(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample) {
  return query.sight == nullptr ||
         !query.sight->isBlocked(sample.position, point, kSightClearance * query.sight->error());
}

float useOfPoint(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample) {
  const glm::vec3 to_eye = query.eye - sample.position;
  const glm::vec3 to_point = point - sample.position;
  const float eye_distance = glm::length(to_eye);
  const float point_distance = glm::length(to_point);
  if (!(eye_distance > 0.0F) || !(point_distance > 0.0F)) return 0.0F;
  const float cosine = glm::dot(to_eye, to_point) / (eye_distance * point_distance);
  if (!(cosine > 0.0F)) return 0.0F;

  // The blur of the image at the sample, in pixels of the view.
  const float focal_face = 0.5F * static_cast<float>(query.grid.face_size);
  const float view_resolution = query.pixels_per_unit_at_one / eye_distance;
  const float face_resolution = focal_face / point_distance;
  const float covers = std::max(1.0F, view_resolution / face_resolution);
  const float shift = kTypicalError * query.error_px * std::sqrt(std::max(0.0F, 1.0F - cosine * cosine)) / cosine;
  const float blur = std::sqrt(covers * covers + shift * shift);

  // How much the surface faces the point. Scans are open, so a surface seen from behind counts like one seen from the
  // front.
  float facing = cosine;
  if (glm::dot(sample.normal, sample.normal) > 0.0F) {
    float towards_eye = glm::dot(sample.normal, to_eye) / eye_distance;
    float towards_point = glm::dot(sample.normal, to_point) / point_distance;
    if (towards_eye < 0.0F) towards_eye = -towards_eye, towards_point = -towards_point;
    facing = std::clamp(towards_point / std::max(towards_eye, kGrazing), 0.0F, 1.0F);
  }
  return facing / blur;
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
  for (const glm::uvec3& point : pointsTowardsSurface(query, samples)) {
    if (candidates.size() >= kMaxCandidates) break;
    if (std::find(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(corner_count), point) ==
        candidates.begin() + static_cast<std::ptrdiff_t>(corner_count))
      candidates.push_back(point);
  }
  std::vector<std::vector<float>> uses(candidates.size(), std::vector<float>(samples.size()));
  for (std::size_t c = 0; c < candidates.size(); ++c)
    for (std::size_t s = 0; s < samples.size(); ++s)
      uses[c][s] = useOfPoint(query, query.grid.point(candidates[c].x, candidates[c].y, candidates[c].z), samples[s]);

  GreedyChoice choice{uses, samples, [&](std::size_t c) { zeroHidden(query, candidates[c], samples, uses[c]); }};
  std::vector<ChosenPoint> chosen;
  for (const ChosenItem& item : chooseGreedily(choice, indicesBelow(candidates.size()), query.max_points))
    if (isOfUse(uses[item.item])) chosen.push_back({candidates[item.item], item.gain});
  return chosen;
}

std::vector<repository::FaceKey> orderFaces(const PointQuery& query, std::span<const glm::uvec3> points,
                                            std::vector<SurfaceSample> samples) {
  sortSamples(samples);

  // A face has its point's uses for the samples that lie in it.
  std::vector<repository::FaceKey> faces;
  std::vector<std::vector<float>> uses;
  for (const glm::uvec3& p : points) {
    const glm::vec3 point = query.grid.point(p.x, p.y, p.z);
    std::vector<float> of_point(samples.size());
    for (std::size_t s = 0; s < samples.size(); ++s) of_point[s] = useOfPoint(query, point, samples[s]);
    zeroHidden(query, p, samples, of_point);
    std::array<std::vector<float>, 6> of_face;
    for (std::size_t s = 0; s < samples.size(); ++s) {
      const glm::vec3 direction = samples[s].position - point;
      if (!(glm::dot(direction, direction) > 0.0F)) continue;
      std::vector<float>& row = of_face[repository::faceOfDirection(direction)];
      row.resize(samples.size(), 0.0F);
      row[s] = of_point[s];
    }
    for (std::uint32_t d = 0; d < 6; ++d) {
      if (!isOfUse(of_face[d])) continue;
      faces.push_back({p.x, p.y, p.z, d});
      uses.push_back(std::move(of_face[d]));
    }
  }

  GreedyChoice choice{uses, samples, [](std::size_t) {}};
  std::vector<repository::FaceKey> ordered;
  for (const ChosenItem& item : chooseGreedily(choice, indicesBelow(faces.size()), faces.size()))
    ordered.push_back(faces[item.item]);
  return ordered;
}

}  // namespace plan
