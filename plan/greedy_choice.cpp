#include "plan/greedy_choice.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

namespace plan {
namespace {

using base::Float4;
using base::Int4;

constexpr float kSecondBest = 0.5F;  // weight of the second image of a place, a choice
constexpr float kGrazing = 0.2F;     // cosine below which the ratio of the two facings is dominated by noise
/// Sums of a few hundred floats differ by less from what they should be.
constexpr float kBoundSlack = 1.0F + 1e-4F;
/// An item's samples are tested in so many portions, each from all over the picture.
constexpr std::size_t kPortions = 8;

// ---- uses ----

LUMIGRID_ALWAYS_INLINE Float4 fourOf(float value) {
  return Float4{value, value, value, value};
}
LUMIGRID_ALWAYS_INLINE Float4 maxOf(Float4 a, Float4 b) {
  return b > a ? b : a;
}
LUMIGRID_ALWAYS_INLINE Float4 rootOf(Float4 x) {
  return Float4{std::sqrt(x[0]), std::sqrt(x[1]), std::sqrt(x[2]), std::sqrt(x[3])};
}

struct FourPoints {
  Float4 x, y, z;
};
LUMIGRID_ALWAYS_INLINE Float4 dotOf(const FourPoints& a, const glm::vec3& b) {
  return a.x * fourOf(b.x) + a.y * fourOf(b.y) + a.z * fourOf(b.z);
}

/// useOfPoint() for four points by the same arithmetic.
Float4 useOfFour(const PointQuery& query, const FourPoints& points, const SurfaceSample& sample) {
  const Float4 zero{};
  const glm::vec3 to_eye = query.eye - sample.position;
  const float eye_distance = glm::length(to_eye);
  if (!(eye_distance > 0.0F)) return zero;
  const FourPoints to_point{points.x - fourOf(sample.position.x), points.y - fourOf(sample.position.y),
                            points.z - fourOf(sample.position.z)};
  const Float4 distance = rootOf(to_point.x * to_point.x + to_point.y * to_point.y + to_point.z * to_point.z);
  const Float4 cosine = dotOf(to_point, to_eye) / (fourOf(eye_distance) * distance);
  const Int4 is_of_use = (distance > zero) & (cosine > zero);
  if ((is_of_use[0] | is_of_use[1] | is_of_use[2] | is_of_use[3]) == 0) return zero;

  const Float4 one = fourOf(1.0F);
  const Float4 face_resolution = fourOf(0.5F * static_cast<float>(query.grid.face_size)) / distance;
  const Float4 covers = maxOf(one, fourOf(query.pixels_per_unit_at_one / eye_distance) / face_resolution);
  const Float4 shift = fourOf(kTypicalError * query.error_px) * rootOf(maxOf(zero, one - cosine * cosine)) / cosine;
  const Float4 blur = rootOf(covers * covers + shift * shift);
  Float4 facing = cosine;
  if (glm::dot(sample.normal, sample.normal) > 0.0F) {
    float towards_eye = glm::dot(sample.normal, to_eye) / eye_distance;
    Float4 towards_point = dotOf(to_point, sample.normal) / distance;
    if (towards_eye < 0.0F) towards_eye = -towards_eye, towards_point = -towards_point;
    const Float4 ratio = towards_point / fourOf(std::max(towards_eye, kGrazing));
    facing = ratio < zero ? zero : (one < ratio ? one : ratio);
  }
  const Float4 use = facing / blur;
  return is_of_use ? use : zero;
}

// ---- the worth of a set of items ----

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

class GreedyChoice {
 public:
  GreedyChoice(UseTable& uses, std::span<const SurfaceSample> samples, const IsShown& is_shown)
      : uses_(uses),
        samples_(samples),
        is_shown_(is_shown),
        worths_(samples.size()),
        bounds_(uses.items()),
        is_gain_(uses.items(), 1),
        portions_(uses.items(), is_shown ? 0 : kPortions) {
    boundAll();
  }

  std::vector<ChosenItem> choose(std::size_t limit) {
    std::vector<ChosenItem> chosen;
    limit = std::min(limit, bounds_.size());
    chosen.reserve(limit);
    while (chosen.size() < limit) {
      const std::size_t best = findBest();
      chosen.push_back({best, bounds_[best]});
      for (std::size_t s = 0; s < samples_.size(); ++s) worths_[s].add(uses_.at(best, s));
      for (float& bound : bounds_) bound *= kBoundSlack;
      std::fill(is_gain_.begin(), is_gain_.end(), 0);
      bounds_[best] = kIsChosen;
    }
    return chosen;
  }

 private:
  static constexpr float kIsChosen = -1.0F;

  /// The gains of all while nothing is chosen: the sums of their uses.
  void boundAll() {
    for (std::size_t first = 0; first < bounds_.size(); first += UseTable::kLanes) {
      Float4 sum{};
      for (std::size_t s = 0; s < samples_.size(); ++s)
        sum += fourOf(samples_[s].weight) * uses_.block(first / UseTable::kLanes, s);
      for (std::size_t i = first; i < std::min(first + UseTable::kLanes, bounds_.size()); ++i)
        bounds_[i] = sum[i - first];
    }
  }

  float gainOf(std::size_t item) const {
    float sum = 0.0F;
    for (std::size_t s = 0; s < samples_.size(); ++s) sum += samples_[s].weight * worths_[s].gain(uses_.at(item, s));
    return sum;
  }

  std::size_t findBest() {
    for (;;) {
      const auto best = static_cast<std::size_t>(std::max_element(bounds_.begin(), bounds_.end()) - bounds_.begin());
      if (is_gain_[best] != 0 && portions_[best] == kPortions) return best;
      if (is_gain_[best] != 0) testPortion(best);
      bounds_[best] = gainOf(best);
      is_gain_[best] = 1;
    }
  }

  void testPortion(std::size_t item) {
    for (std::size_t s = portions_[item]++; s < samples_.size(); s += kPortions)
      if (uses_.at(item, s) > 0.0F && !is_shown_(item, s)) uses_.set(item, s, 0.0F);
  }

  UseTable& uses_;
  std::span<const SurfaceSample> samples_;
  const IsShown& is_shown_;
  std::vector<SampleWorth> worths_;
  std::vector<float> bounds_;          // of what each item adds
  std::vector<std::uint8_t> is_gain_;  // the bound is what it adds to those chosen so far, as far as it is tested
  std::vector<std::size_t> portions_;  // that are tested
};

}  // namespace

bool UseTable::isOfUse(std::size_t item) const {
  for (std::size_t s = 0; s < samples_; ++s)
    if (at(item, s) > 0.0F) return true;
  return false;
}

UseTable usesOfPoints(const PointQuery& query, std::span<const glm::uvec3> points,
                      std::span<const SurfaceSample> samples) {
  UseTable uses(points.size(), samples.size());
  for (std::size_t first = 0; first < points.size(); first += UseTable::kLanes) {
    FourPoints four{};
    for (std::size_t lane = 0; lane < UseTable::kLanes; ++lane) {
      const glm::uvec3& point = points[std::min(first + lane, points.size() - 1)];
      const glm::vec3 place = query.grid.point(point.x, point.y, point.z);
      four.x[lane] = place.x, four.y[lane] = place.y, four.z[lane] = place.z;
    }
    for (std::size_t s = 0; s < samples.size(); ++s)
      uses.block(first / UseTable::kLanes, s) = useOfFour(query, four, samples[s]);
  }
  return uses;
}

std::vector<ChosenItem> chooseGreedily(UseTable& uses, std::span<const SurfaceSample> samples, const IsShown& is_shown,
                                       std::size_t limit) {
  return GreedyChoice(uses, samples, is_shown).choose(limit);
}

float useOfPoint(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample) {
  const Float4 x = fourOf(point.x), y = fourOf(point.y), z = fourOf(point.z);
  return useOfFour(query, {x, y, z}, sample)[0];
}

}  // namespace plan
