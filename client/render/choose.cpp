#include "client/render/choose.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <queue>
#include <utility>

#include "client/render/box_index.h"

namespace client {
namespace {

/// Weighs a box's first image against further ones: gain = quality / (kSaturation + quality so far). Measured:
/// docs/lumigraph-tuning.md.
constexpr float kSaturation = 0.3F;

/// Rays choose so much of the images. Measured: docs/decisions/choice-by-rays.md.
constexpr float kShareByRays = 0.5F;
/// Returns the fourth power of a share of the best weight: at a ray's place, where an image's error decides, one of
/// half the best's weight is of little use, and many such places must not displace the image that is the best of a few.
float sharpened(float quality) {
  return quality * quality * quality * quality;
}

/// Points that have a seventh of the best samples may have more. Samples of other points would be averaged with better
/// ones where these are. Measured: docs/decisions/choice-by-rays.md.
constexpr std::size_t kLeastShareOfPoint = 7;

/// A core is divided into 4 × 4 cells, one bit each, rows from the bottom: what finer samples of the same point show of
/// it. Those four times as fine have a cell each.
constexpr int kCellsAcross = 4;
constexpr std::uint16_t kAllCells = 0xFFFF;

/// Returns the cells from (x0, y0) to (x1, y1), given as −1 … 1 across the core.
template <class Round>
std::uint16_t cellsIn(const glm::vec2& low, const glm::vec2& high, const Round& round) {
  const auto cell = [&](float at) {
    return std::clamp(static_cast<int>(round(0.5F * (at + 1.0F) * kCellsAcross)), 0, kCellsAcross);
  };
  std::uint16_t cells = 0;
  for (int y = cell(low.y); y < kCellsAcross - cell(-high.y); ++y)
    for (int x = cell(low.x); x < kCellsAcross - cell(-high.x); ++x)
      cells = static_cast<std::uint16_t>(cells | 1U << (kCellsAcross * y + x));
  return cells;
}

/// Returns the cells of `coarse` that `fine`, which lies in it, shows whole.
std::uint16_t cellsUnder(const SampleGeometry& fine, const SampleGeometry& coarse) {
  glm::vec2 low(1.0F), high(-1.0F);
  for (const glm::vec3& corner : fine.corners) {
    const glm::vec3 place = coarse.placeInCore(corner);
    low = glm::min(low, glm::vec2(place) / place.z);
    high = glm::max(high, glm::vec2(place) / place.z);
  }
  constexpr float kRounding = 0.05F;  // share of a cell
  return cellsIn(low, high, [](float at) { return std::ceil(at - kRounding); });
}

/// Returns the cells in which a box may be seen; none where it lies beside the core.
std::uint16_t cellsOf(const base::Aabb& box, const SampleGeometry& sample) {
  glm::vec2 low(1.0F), high(-1.0F);
  for (int i = 0; i < 8; ++i) {
    const glm::vec3 place = sample.placeInCore(box.corner(i) - sample.eye);
    if (place.z <= 0.0F) return kAllCells;
    low = glm::min(low, glm::vec2(place) / place.z);
    high = glm::max(high, glm::vec2(place) / place.z);
  }
  return cellsIn(low, high, [](float at) { return std::floor(at); });
}

/// Raises to a power that is mostly a small whole number.
float raised(float x, float power) {
  if (power == 3.0F) return x * x * x;
  return power == 1.0F ? x : std::pow(x, power);
}

/// The box that holds a place, or is nearest to it; the smallest of several.
std::size_t boxAt(std::span<const base::Aabb> boxes, const glm::vec3& place) {
  std::size_t nearest = 0;
  std::pair<float, float> least(std::numeric_limits<float>::max(), 0.0F);
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const glm::vec3 apart = place - glm::clamp(place, boxes[b].min, boxes[b].max);
    const std::pair here(glm::dot(apart, apart), boxes[b].diagonal());
    if (here < least) least = here, nearest = b;
  }
  return nearest;
}

/// One sample looks at one box.
struct Sight {
  std::uint32_t box;
  float quality;                    ///< weight as a share of that of the best sample in the box
  float shown = 0.0F;               ///< the quality that a chosen, coarser sample of the point has here already
  std::uint16_t cells = kAllCells;  ///< where it may see the box,
  std::uint16_t open = kAllCells;   ///< and where no chosen, finer sample of the point shows the same

  float left() const {
    const float gain = std::max(0.0F, quality - shown);
    const auto left = static_cast<std::uint16_t>(cells & open);
    return left == cells ? gain
                         : gain * static_cast<float>(std::popcount(left)) / static_cast<float>(std::popcount(cells));
  }
};

/// Greedy choice with diminishing returns for boxes that have samples already. Gains only fall as more is chosen, so
/// that of a sample is computed again only when it may be the largest (Minoux 1978).
class Choice {
 public:
  Choice(std::span<const SampleGeometry* const> samples, const SampleNesting& nesting,
         std::span<const base::Aabb> boxes, std::span<const ProxyError> errors, const base::Camera& view,
         const BlendTuning& tuning, const VisibleSurface* surface = nullptr)
      : samples_(samples), boxes_(boxes), surface_(surface), nesting_(nesting), had_(boxes.size(), 0.0F) {
    look(errors, view, tuning);
  }

  std::vector<std::size_t> best(std::size_t limit) {
    std::priority_queue<Candidate> queue;
    for (std::size_t s = 0; s < samples_.size(); ++s) queue.push({gainOf(s), s, 0});
    std::vector<std::size_t> chosen;
    while (chosen.size() < limit && !queue.empty() && queue.top().gain > 0.0F) {
      Candidate top = queue.top();
      queue.pop();
      if (top.round == chosen.size()) {
        choose(top.sample);
        chosen.push_back(top.sample);
      } else {
        queue.push({gainOf(top.sample), top.sample, chosen.size()});
      }
    }
    return chosen;
  }

 private:
  struct Candidate {
    float gain;
    std::size_t sample;
    std::size_t round;  ///< number of samples that were chosen when the gain was computed
    bool operator<(const Candidate& other) const {
      return gain != other.gain ? gain < other.gain : sample > other.sample;
    }
  };

  void look(std::span<const ProxyError> errors, const base::Camera& view, const BlendTuning& tuning);
  float gainOf(std::size_t s) const {
    float gain = 0.0F;
    for (const Sight& sight : sights_[s]) gain += sizes_[sight.box] * sight.left() / (kSaturation + had_[sight.box]);
    return gain;
  }
  void choose(std::size_t s) {
    for (const Sight& sight : sights_[s]) had_[sight.box] += sight.left();
    for (const std::uint32_t finer : nesting_.finer[s]) showIn(finer, s);
    for (const std::uint32_t coarser : nesting_.coarser[s]) {
      const auto open = static_cast<std::uint16_t>(~cellsUnder(*samples_[s], *samples_[coarser]));
      for (Sight& sight : sights_[coarser]) sight.open &= open;
    }
  }
  /// Notes in a finer sample what the coarser one shows of its boxes. Both lists are sorted by box.
  void showIn(std::uint32_t finer, std::size_t coarser) {
    auto shown = sights_[coarser].begin();
    for (Sight& sight : sights_[finer]) {
      while (shown != sights_[coarser].end() && shown->box < sight.box) ++shown;
      if (shown == sights_[coarser].end()) return;
      if (shown->box == sight.box) sight.shown = std::max(sight.shown, shown->quality);
    }
  }

  std::span<const SampleGeometry* const> samples_;
  std::span<const base::Aabb> boxes_;
  const VisibleSurface* surface_;  ///< whose places the boxes are; null: they are others
  const SampleNesting& nesting_;
  std::vector<std::vector<Sight>> sights_;  ///< of each sample
  std::vector<float> sizes_;                ///< of each box on the screen
  std::vector<float> had_;                  ///< sum of qualities that each box has
};

/// Fills in what each sample shows.
void Choice::look(std::span<const ProxyError> errors, const base::Camera& view, const BlendTuning& tuning) {
  struct Box {
    glm::vec3 center, to_view;
    float radius, distance, error_px;
    float best = 0.0F;
  };
  std::vector<Box> looked;
  for (std::size_t b = 0; b < boxes_.size(); ++b) {
    Box box{boxes_[b].center(), {}, 0.5F * boxes_[b].diagonal() + 1e-20F, 1.0F, 0.0F};
    box.to_view = view.towardsViewer(box.center);
    if (!view.orthographic()) box.distance = std::max(glm::length(box.to_view), box.radius);
    box.error_px = errors[b].shape * view.pixelsPerUnitAtOne() / box.distance;
    sizes_.push_back(surface_ != nullptr ? 1.0F : box.radius / box.distance * (box.radius / box.distance));
    looked.push_back(box);
  }

  const BoxIndex index(boxes_);
  std::vector<std::uint32_t> overlapping;
  sights_.resize(samples_.size());
  for (std::size_t s = 0; s < samples_.size(); ++s) {
    const SampleGeometry& sample = *samples_[s];
    index.findOverlapping(sample.frustum, overlapping);
    for (const std::uint32_t b : overlapping) {
      Box& box = looked[b];
      const float distance = std::max(glm::length(box.center - sample.eye), box.radius);
      const float ratio = sample.pixels_per_unit_at_one / distance / (view.pixelsPerUnitAtOne() / box.distance);
      const float weight = sampleWeight(box.to_view, sample.eye - box.center, ratio, box.error_px, tuning);
      if (!std::isfinite(weight)) continue;  // from an eye in the box's middle there is no direction
      const std::uint16_t cells = nesting_.finer[s].empty() ? kAllCells : cellsOf(boxes_[b], sample);
      if (cells == 0 || (surface_ != nullptr && !surface_->is_seen_from(sample.eye, b))) continue;
      sights_[s].push_back({.box = b, .quality = weight, .cells = cells});
      box.best = std::max(box.best, weight);
    }
  }
  for (std::vector<Sight>& sights : sights_)
    for (Sight& sight : sights) {
      if (!(looked[sight.box].best > 0.0F)) continue;
      const float share = sight.quality / looked[sight.box].best;
      sight.quality = surface_ != nullptr ? sharpened(share) : share;
    }
}

}  // namespace

float sampleWeight(const glm::vec3& to_view, const glm::vec3& to_sample, float ratio, float error_px,
                   const BlendTuning& tuning) {
  const float angle = glm::length(glm::normalize(to_view) - glm::normalize(to_sample));
  const float blur = 1.0F / std::min(1.0F, ratio);
  const float shift = tuning.shift * error_px * angle;
  return 1.0F / (raised(blur * blur + shift * shift, 0.5F * tuning.resolution_power) *
                 raised(angle + tuning.angle_floor, tuning.angle_power));
}

std::vector<std::size_t> chooseSamples(std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, std::span<const ProxyError> errors,
                                       const base::Camera& view, std::size_t limit, const BlendTuning& tuning,
                                       const VisibleSurface* surface, std::size_t more) {
  const SampleNesting nesting = nestingOf(samples);
  std::vector<std::size_t> chosen;
  if (surface != nullptr && !boxes.empty()) {
    std::vector<base::Aabb> places;
    std::vector<ProxyError> errors_there;
    for (const glm::vec3& place : surface->places) {
      places.push_back({place, place});
      errors_there.push_back(errors[boxAt(boxes, place)]);
    }
    const auto most = static_cast<std::size_t>(std::ceil(kShareByRays * static_cast<float>(limit)));
    chosen = Choice(samples, nesting, places, errors_there, view, tuning, surface).best(most);
  }
  std::vector<bool> has(samples.size(), false);
  for (const std::size_t sample : chosen) has[sample] = true;
  std::vector<std::size_t> others;
  const std::size_t asked = more > 0 ? samples.size() : limit;
  for (const std::size_t sample : Choice(samples, nesting, boxes, errors, view, tuning).best(asked))
    if (!has[sample]) (chosen.size() < limit ? chosen : others).push_back(sample);

  const std::vector<std::size_t> best = chosen;
  for (const std::size_t sample : others) {
    if (chosen.size() >= best.size() + more) break;
    const auto of_its_point = static_cast<std::size_t>(std::count_if(
        best.begin(), best.end(), [&](std::size_t other) { return samples[other]->eye == samples[sample]->eye; }));
    if (kLeastShareOfPoint * of_its_point >= limit) chosen.push_back(sample);
  }
  return chosen;
}

}  // namespace client
