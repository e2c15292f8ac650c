#pragma once
// Chooses items (points, faces) one after the other by the worth that each adds for the samples of a view: Σ weight ·
// (best use + ½ · second best use), since two images of a place fill each other's holes and further ones add little.
// Private to plan/.
//
// The gain of an item only shrinks: while others are chosen, and when samples turn out to be hidden from it. So a gain
// of earlier is a bound, and an item is looked at again only when its bound is the largest (Minoux 1978, "Accelerated
// greedy algorithms"). Lines of sight cost most. They are tested for such items only, and by portions.
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "base/simd.h"
#include "plan/point_choice.h"

namespace plan {

/// The use of every item for every sample. Four items lie side by side, as many as a vector has lanes.
class UseTable {
 public:
  UseTable(std::size_t items, std::size_t samples)
      : items_(items), samples_(samples), uses_((items + kLanes - 1) / kLanes * samples, base::Float4{}) {}

  static constexpr std::size_t kLanes = 4;
  std::size_t items() const { return items_; }
  std::size_t samples() const { return samples_; }
  /// The uses of items 4 · block … 4 · block + 3, one a lane. Lanes behind the last item mean nothing.
  base::Float4& block(std::size_t block, std::size_t sample) { return uses_[block * samples_ + sample]; }
  const base::Float4& block(std::size_t block, std::size_t sample) const { return uses_[block * samples_ + sample]; }
  float at(std::size_t item, std::size_t sample) const { return block(item / kLanes, sample)[item % kLanes]; }
  void set(std::size_t item, std::size_t sample, float use) { block(item / kLanes, sample)[item % kLanes] = use; }
  bool isOfUse(std::size_t item) const;  ///< for some sample

 private:
  std::size_t items_, samples_;
  std::vector<base::Float4> uses_;
};

/// The uses of points, of which each is an item, by useOfPoint().
UseTable usesOfPoints(const PointQuery& query, std::span<const glm::uvec3> points,
                      std::span<const SurfaceSample> samples);

struct ChosenItem {
  std::size_t item = 0;
  float gain = 0.0F;  ///< the worth that it adds
};
/// Tells whether an item shows a sample. It is asked once at most, and only where the item is of use.
using IsShown = std::function<bool(std::size_t item, std::size_t sample)>;

/// Chooses up to `limit` items, of equally good ones the first; those of no use come last. `uses` of samples that an
/// item does not show become 0. `is_shown` may be null.
std::vector<ChosenItem> chooseGreedily(UseTable& uses, std::span<const SurfaceSample> samples, const IsShown& is_shown,
                                       std::size_t limit);

}  // namespace plan
