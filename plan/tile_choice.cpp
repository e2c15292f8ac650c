#include "plan/tile_choice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <queue>
#include <unordered_map>

#include "base/check.h"
#include "repository/sampling/cube_face.h"

namespace plan {
namespace {

// The first four are BlendTuning's (client/render/lumigraph.h).
constexpr float kImageNoise2 = 1e-4F;
constexpr float kProxyNoise2 = 1.6e-5F;
constexpr float kShift = 3.0F;
constexpr float kShadeBlur = 0.7F;
constexpr float kLookUp = 3.0F;  // the shader's: variance of a texel's box and of looking it up, over that of a box
/// q of the formula. A choice: more of it brings second images sooner, less brings finer tiles first.
constexpr float kFailingShare = 0.1F;
/// A tile of some 10 kB that gains less is not sent. A picture of 40 dB has an error of 1e-4.
constexpr float kLeastGain = 2e-7F;

/// A sample's expected error with the tiles chosen so far.
struct SampleError {
  float best = 0.0F, second = 0.0F;
  std::size_t best_point = SIZE_MAX, second_point = SIZE_MAX;

  float expected() const { return (1.0F - kFailingShare) * best + kFailingShare * second; }
  void add(std::size_t point, float error2) {
    if (point == best_point) {
      best = std::min(best, error2);
    } else if (error2 < best) {
      second = best, second_point = best_point;
      best = error2, best_point = point;
    } else if (error2 < second) {
      second = error2, second_point = point;
    }
  }
};

struct Item {
  repository::FaceKey key;
  std::size_t point = 0;
  std::vector<std::pair<std::uint32_t, float>> errors;  // sample, e²
};

/// One sample as one point's images see it, whatever their depth.
struct Sighting {
  glm::vec3 direction{0.0F};  // from the point
  float density = 0.0F;       // view pixels a unit
  float distance = 0.0F;
  float slant = 1.0F;   // cosine between normal and ray to the point
  float slope2 = 0.0F;  // (c / b)²
  float shift = 0.0F;   // view pixels
};

float errorAt(const Sighting& sighting, float focal) {
  const float ratio = focal / sighting.distance / sighting.density;
  const float texel = 1.0F / std::clamp(ratio * sighting.slant, 0.01F, 1.0F);
  return kImageNoise2 + sighting.slope2 * (kLookUp * texel * texel - 1.0F + sighting.shift * sighting.shift);
}

bool isSharp(const Sighting& sighting, float focal) {
  return focal / sighting.distance / sighting.density * sighting.slant >= 1.0F;
}

class TileChoice {
 public:
  TileChoice(const TileQuery& query, std::span<const SurfaceSample> samples, std::span<const ProxyShading> proxies)
      : query_(query), samples_(samples), proxies_(proxies), errors_(samples.size()) {
    for (std::size_t s = 0; s < samples.size(); ++s)
      errors_[s].best = errors_[s].second = proxies[s].color_error * proxies[s].color_error + kProxyNoise2;
  }

  void addPoint(std::size_t number, const glm::uvec3& point) {
    const glm::vec3 place = query_.points.grid.point(point.x, point.y, point.z);
    std::unordered_map<std::uint64_t, std::size_t> items;
    for (std::size_t s = 0; s < samples_.size(); ++s) {
      Sighting sighting;
      if (!sees(place, samples_[s], proxies_[s], sighting)) continue;
      addSighting(number, point, sighting, static_cast<std::uint32_t>(s), items);
    }
  }

  /// Gains only fall as tiles are chosen, but for rare second images, so each is computed again only when it would be
  /// the next.
  std::vector<ChosenTile> choose() {
    for (const Item& item : items_)
      if (query_.is_here(item.key)) addItem(item);
    std::priority_queue<std::pair<float, std::size_t>> open;
    for (std::size_t i = 0; i < items_.size(); ++i) open.emplace(gainOf(items_[i]), items_.size() - i);
    std::vector<ChosenTile> chosen;
    while (!open.empty() && chosen.size() < query_.max_tiles) {
      const std::size_t place = open.top().second;
      open.pop();
      const Item& item = items_[items_.size() - place];
      const float gain = gainOf(item);
      if (!open.empty() && gain < open.top().first) {
        open.emplace(gain, place);
        continue;
      }
      if (gain < kLeastGain) break;
      addItem(item);
      chosen.push_back({item.key, gain});
    }
    return chosen;
  }

 private:
  bool sees(const glm::vec3& place, const SurfaceSample& sample, const ProxyShading& proxy, Sighting& sighting) const {
    const glm::vec3 to_eye = query_.points.eye - sample.position;
    const glm::vec3 to_point = place - sample.position;
    const float eye_distance = glm::length(to_eye);
    sighting.distance = glm::length(to_point);
    if (!(eye_distance > 0.0F) || !(sighting.distance > 0.0F)) return false;
    float view_slant = 1.0F;
    if (glm::dot(sample.normal, sample.normal) > 0.0F) {
      // A surface that turns away from the point is not seen by it. Scans are open, so either side may be looked at.
      const float towards_eye = glm::dot(sample.normal, to_eye) / eye_distance;
      const float towards_point = glm::dot(sample.normal, to_point) / sighting.distance;
      sighting.slant = towards_eye < 0.0F ? -towards_point : towards_point;
      if (sighting.slant <= 0.0F) return false;
      view_slant = std::max(std::abs(towards_eye), 0.05F);
    }
    if (!isInSight(query_.points, place, sample)) return false;
    sighting.direction = -to_point;
    sighting.density = query_.points.pixels_per_unit_at_one / eye_distance;
    const float blur = std::max(kShadeBlur * proxy.edge * sighting.density, 1.0F) / view_slant;
    sighting.slope2 = proxy.color_error * proxy.color_error / (blur * blur);
    const float angle = glm::length(to_eye / eye_distance - to_point / sighting.distance);
    sighting.shift = kShift * proxy.shape_error * sighting.density * angle;
    return true;
  }

  void addSighting(std::size_t number, const glm::uvec3& point, const Sighting& sighting, std::uint32_t sample,
                   std::unordered_map<std::uint64_t, std::size_t>& items) {
    const repository::Grid& grid = query_.points.grid;
    const auto focalAt = [&](std::uint32_t depth) { return 0.5F * static_cast<float>(grid.faceSideAt(depth)); };
    std::uint32_t deepest = 0;
    while (deepest < grid.tile_depth && !isSharp(sighting, focalAt(deepest))) ++deepest;

    // The tiles that show this place, from the whole face down to the finest that is of use.
    const repository::FaceKey finest = repository::tileOfDirection(sighting.direction, deepest);
    std::array<std::uint32_t, repository::kMaxTileDepth + 1> path{};
    path[deepest] = finest.tile;
    for (std::uint32_t depth = deepest; depth > 0; --depth) path[depth - 1] = repository::parentOfTile(path[depth]);

    // An absent tile leaves what it would have shown to the one above it.
    const auto keyAt = [&](std::uint32_t depth) {
      return repository::FaceKey{point.x, point.y, point.z, finest.d, path[depth]};
    };
    std::uint32_t last = 0;
    while (last < deepest && !isAbsent(keyAt(last + 1))) ++last;
    for (std::uint32_t depth = 0; depth <= last; ++depth) {
      const float error2 = errorAt(sighting, focalAt(depth == last ? deepest : depth));
      if (error2 < errors_[sample].best) itemOf(keyAt(depth), number, items).errors.emplace_back(sample, error2);
    }
  }

  bool isAbsent(const repository::FaceKey& key) {
    const auto [found, is_new] = absent_.try_emplace(key.code(), false);
    if (is_new) found->second = query_.is_absent(key);
    return found->second;
  }

  Item& itemOf(const repository::FaceKey& key, std::size_t number,
               std::unordered_map<std::uint64_t, std::size_t>& items) {
    const auto [found, is_new] = items.try_emplace(key.code(), items_.size());
    if (is_new) items_.push_back({key, number, {}});
    return items_[found->second];
  }

  void addItem(const Item& item) {
    for (const auto& [sample, error2] : item.errors) errors_[sample].add(item.point, error2);
  }

  float gainOf(const Item& item) const {
    float sum = 0.0F;
    for (const auto& [sample, error2] : item.errors) {
      SampleError after = errors_[sample];
      after.add(item.point, error2);
      sum += samples_[sample].weight * (errors_[sample].expected() - after.expected());
    }
    return sum;
  }

  const TileQuery& query_;
  std::span<const SurfaceSample> samples_;
  std::span<const ProxyShading> proxies_;
  std::vector<SampleError> errors_;
  std::vector<Item> items_;
  std::unordered_map<std::uint64_t, bool> absent_;  // by code, as far as it was asked
};

}  // namespace

std::vector<ChosenTile> chooseTiles(const TileQuery& query, std::span<const glm::uvec3> points,
                                    std::span<const SurfaceSample> samples, std::span<const ProxyShading> proxies) {
  LUMIGRID_CHECK_EQ(samples.size(), proxies.size());
  TileChoice choice(query, samples, proxies);
  for (std::size_t i = 0; i < points.size(); ++i) choice.addPoint(i, points[i]);
  return choice.choose();
}

}  // namespace plan
