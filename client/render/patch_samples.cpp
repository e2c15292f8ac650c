#include "client/render/patch_samples.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>

#include "client/render/box_index.h"
#include "client/render/choose.h"

namespace client {
namespace {

/// Returns places all over a box: its middle, and halfway to its corners.
std::array<glm::vec3, 9> placesIn(const base::Aabb& box) {
  std::array<glm::vec3, 9> places;
  places.fill(box.center());
  for (int i = 0; i < 8; ++i) places[static_cast<std::size_t>(i)] = 0.5F * (box.center() + box.corner(i));
  return places;
}

/// The points that the samples of one patch are from.
class Points {
 public:
  Points(std::span<const std::uint32_t> samples, std::span<const std::uint32_t> points) {
    for (std::size_t i = 0; i < samples.size(); ++i) {
      if (i == 0 || points[samples[i]] != points[samples[i - 1]]) weights_.push_back(0.0F);
      of_sample_.push_back(weights_.size() - 1);
    }
  }
  std::size_t count() const { return weights_.size(); }

  /// Adds what samples weigh at one place, of each point the finest: its share of the best one's.
  void addPlace(std::span<const float> weights_here) {
    std::vector<float> here(weights_.size(), 0.0F);
    for (std::size_t i = 0; i < weights_here.size(); ++i)
      here[of_sample_[i]] = std::max(here[of_sample_[i]], weights_here[i]);
    const float best = *std::max_element(here.begin(), here.end());
    if (!(best > 0.0F)) return;
    for (std::size_t p = 0; p < here.size(); ++p) weights_[p] += here[p] / best;
  }

  /// Leaves only the samples of so many points, those of the largest weight. There must be more.
  void keepBest(std::size_t left, std::vector<std::uint32_t>& samples) const {
    std::vector<std::pair<float, std::size_t>> order;  // the best first
    for (std::size_t p = 0; p < weights_.size(); ++p) order.emplace_back(-weights_[p], p);
    std::sort(order.begin(), order.end());
    const std::pair<float, std::size_t> first_left_out = order[left];
    std::size_t kept = 0;
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (std::pair(-weights_[of_sample_[i]], of_sample_[i]) < first_left_out) samples[kept++] = samples[i];
    samples.resize(kept);
  }

 private:
  std::vector<float> weights_;          // of each point
  std::vector<std::size_t> of_sample_;  // place in weights_ of each sample
};

/// Pixels across a cell, about: a tile of 256 texels covers a few. A choice.
constexpr float kCellPixels = 48.0F;

/// Returns the box of a cell.
base::Aabb cellBox(const base::Aabb& box, const glm::ivec3& counts, const glm::ivec3& cell) {
  const glm::vec3 step = (box.max - box.min) / glm::vec3(counts);
  return {box.min + step * glm::vec3(cell), box.min + step * glm::vec3(cell + 1)};
}

}  // namespace

std::vector<PatchCells> cellsOfPatches(const std::vector<std::vector<std::uint32_t>>& lists,
                                       std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, const base::Camera& view) {
  std::vector<PatchCells> result(boxes.size());
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    const base::Aabb& box = boxes[b];
    PatchCells& cells = result[b];
    const glm::vec3 extent = box.max - box.min;
    constexpr float kAtTheEye = 1e20F;
    const glm::vec3 pixels = extent * std::min(view.pixelsPerUnit(box.center()), kAtTheEye);
    const auto most = static_cast<float>(kMostCellsAcross);
    cells.counts = glm::ivec3(glm::clamp(glm::ceil(pixels / kCellPixels), glm::vec3(1.0F), glm::vec3(most)));
    cells.begin = box.min;
    cells.per_unit = glm::vec3(cells.counts) / glm::max(extent, glm::vec3(1e-20F));
    cells.samples = lists[b].size();
    const glm::ivec3& counts = cells.counts;
    for (int c = 0; c < counts.x * counts.y * counts.z; ++c) {
      const base::Aabb part = cellBox(box, counts, {c % counts.x, c / counts.x % counts.y, c / (counts.x * counts.y)});
      std::vector<std::uint32_t>& list = cells.lists.emplace_back();
      std::copy_if(lists[b].begin(), lists[b].end(), std::back_inserter(list),
                   [&](std::uint32_t sample) { return samples[sample]->frustum.mayOverlap(part); });
    }
  }
  return result;
}

std::vector<std::vector<std::uint32_t>> samplesOfPatches(std::span<const SampleGeometry* const> samples,
                                                         std::span<const std::uint32_t> points,
                                                         std::span<const base::Aabb> boxes,
                                                         std::span<const ProxyError> errors, const base::Camera& view,
                                                         std::size_t max_points, const BlendTuning& tuning) {
  std::vector<std::vector<std::uint32_t>> lists(boxes.size());
  const BoxIndex index(boxes);
  std::vector<std::uint32_t> overlapping;
  for (std::uint32_t s = 0; s < samples.size(); ++s) {
    index.findOverlapping(samples[s]->frustum, overlapping);
    for (const std::uint32_t box : overlapping) lists[box].push_back(s);
  }

  std::vector<float> weights;
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    Points by_point(lists[b], points);
    if (by_point.count() <= max_points) continue;
    for (const glm::vec3& place : placesIn(boxes[b])) {
      const float density = view.pixelsPerUnit(place);
      const glm::vec3 to_view = view.towardsViewer(place);
      weights.clear();
      for (const std::uint32_t s : lists[b]) {
        const glm::vec3 to_sample = samples[s]->eye - place;
        const float ratio = samples[s]->pixels_per_unit_at_one / glm::length(to_sample) / density;
        const float weight = sampleWeight(to_view, to_sample, ratio, errors[b].shape * density, tuning);
        weights.push_back(std::isfinite(weight) ? weight : 0.0F);  // at an eye there is no direction
      }
      by_point.addPlace(weights);
    }
    by_point.keepBest(max_points, lists[b]);
  }
  return lists;
}

}  // namespace client
