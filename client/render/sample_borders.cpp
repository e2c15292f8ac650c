#include "client/render/sample_borders.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace client {
namespace {

/// Cosine: corners within 1.4 mrad, less than a pixel of a 90° face of 1024.
constexpr float kSameDirection = 1.0F - 1e-6F;
constexpr float kSameAngle = 1.4e-3F;  ///< the same, in radians

/// Component of SampleBorders for each side, in the order of the corners: bottom, right, top, left.
constexpr std::array<int, 4> kComponentOfSide{2, 1, 3, 0};

glm::vec3 cornerOf(const SampleGeometry& sample, int i) {
  return sample.corners[static_cast<std::size_t>(i & 3)];
}
int componentOf(int side) {
  return kComponentOfSide[static_cast<std::size_t>(side)];
}

/// Whether side a of one sample lies on side b of another: their corners coincide, in either order.
bool sidesCoincide(const SampleGeometry& one, int a, const SampleGeometry& other, int b) {
  const auto same = [](const glm::vec3& u, const glm::vec3& v) { return glm::dot(u, v) > kSameDirection; };
  return (same(cornerOf(one, a), cornerOf(other, b)) && same(cornerOf(one, a + 1), cornerOf(other, b + 1))) ||
         (same(cornerOf(one, a), cornerOf(other, b + 1)) && same(cornerOf(one, a + 1), cornerOf(other, b)));
}

struct Part {
  float from, to;  ///< 0 … 1 along a side
};

/// Returns the part of side b of `coarse` on which side a of `fine` lies; nothing where it lies elsewhere.
std::optional<Part> partOfSide(const SampleGeometry& fine, int a, const SampleGeometry& coarse, int b) {
  const glm::vec3 first = cornerOf(coarse, b) / coarse.placeInCore(cornerOf(coarse, b)).z;
  const glm::vec3 second = cornerOf(coarse, b + 1) / coarse.placeInCore(cornerOf(coarse, b + 1)).z;
  const glm::vec3 across = glm::cross(first, second);
  const glm::vec3 normal = glm::normalize(across);
  const auto along = [&](const glm::vec3& direction) {
    const float after = glm::dot(glm::cross(first, direction), normal);
    const float before = glm::dot(glm::cross(direction, second), normal);
    return after / (after + before);
  };
  const auto lies = [&](const glm::vec3& direction) {
    return std::abs(glm::dot(normal, direction)) < kSameAngle &&
           glm::dot(glm::cross(first, direction), normal) > -kSameAngle &&
           glm::dot(glm::cross(direction, second), normal) > -kSameAngle;
  };
  if (!lies(cornerOf(fine, a)) || !lies(cornerOf(fine, a + 1))) return std::nullopt;
  const float one = along(cornerOf(fine, a)), other = along(cornerOf(fine, a + 1));
  return Part{std::min(one, other), std::max(one, other)};
}

/// Whether the cores lie on the two sides of the plane through side b of `one`.
bool liesBeyond(const SampleGeometry& other, const SampleGeometry& one, int b) {
  const glm::vec3 normal = glm::cross(cornerOf(one, b), cornerOf(one, b + 1));
  const auto middle = [](const SampleGeometry& s) { return s.corners[0] + s.corners[1] + s.corners[2] + s.corners[3]; };
  return glm::dot(normal, middle(one)) * glm::dot(normal, middle(other)) < 0.0F;
}

/// The borders of one frame's samples, step by step: each step fills in sides that those before have left open.
class Borders {
 public:
  Borders(std::span<const SampleGeometry* const> samples, std::span<const float> fades, const SampleNesting& nesting)
      : samples_(samples), fades_(fades), nesting_(nesting), borders_(samples.size()), neighbours_(samples.size()) {
    for (std::uint32_t i = 0; i < samples.size(); ++i)
      for (std::uint32_t j = 0; j < samples.size(); ++j)
        if (i != j && sameCentre(*samples[i], *samples[j])) neighbours_[i].push_back(j);
  }

  std::vector<SampleBorders> take() {
    for (std::uint32_t i = 0; i < samples_.size(); ++i)
      if (fades_[i] > 0.0F) meetEquals(i);
    forOpenSides([this](std::uint32_t i, int side) { meetFiner(i, side); });
    forOpenSides([this](std::uint32_t i, int side) { meetCoarser(i, side); });
    for (const std::uint32_t i : coarsestFirst()) lieOverCoarser(i);
    return std::move(borders_);
  }

 private:
  template <class Step>
  void forOpenSides(const Step& step) {
    for (std::uint32_t i = 0; i < samples_.size(); ++i)
      for (int side = 0; side < 4; ++side)
        if (fades_[i] > 0.0F && !neighbours_[i].empty() && floorAt(i, side) == 0.0F) step(i, side);
  }
  float& floorAt(std::uint32_t i, int side) { return borders_[i].floors[componentOf(side)]; }
  float density(std::uint32_t i) const { return samples_[i]->pixels_per_unit_at_one; }
  std::vector<std::uint32_t> coarsestFirst() const {
    std::vector<std::uint32_t> order;
    for (std::uint32_t i = 0; i < samples_.size(); ++i)
      if (fades_[i] > 0.0F && !nesting_.coarser[i].empty()) order.push_back(i);
    std::sort(order.begin(), order.end(), [this](std::uint32_t a, std::uint32_t b) { return density(a) < density(b); });
    return order;
  }

  void meetEquals(std::uint32_t i) {
    for (const std::uint32_t j : neighbours_[i])
      for (int a = 0; a < 4; ++a)
        for (int b = 0; b < 4; ++b) {
          if (!sidesCoincide(*samples_[i], a, *samples_[j], b)) continue;
          floorAt(i, a) = std::max(floorAt(i, a), std::min(1.0F, fades_[j] / fades_[i]));
        }
  }

  /// Keeps the weight where finer samples lie side by side beyond the whole side.
  void meetFiner(std::uint32_t i, int side) {
    std::vector<Part> parts;
    float floor = 1.0F;
    for (const std::uint32_t j : neighbours_[i]) {
      if (density(j) <= density(i) || fades_[j] <= 0.0F || !liesBeyond(*samples_[j], *samples_[i], side)) continue;
      for (int a = 0; a < 4; ++a)
        if (const auto part = partOfSide(*samples_[j], a, *samples_[i], side)) {
          parts.push_back(*part);
          floor = std::min(floor, fades_[j] / fades_[i]);
        }
    }
    std::sort(parts.begin(), parts.end(), [](const Part& a, const Part& b) { return a.from < b.from; });
    float reached = 0.0F;
    constexpr float kGap = 0.01F;
    for (const Part& part : parts)
      if (part.from < reached + kGap) reached = std::max(reached, part.to);
    if (reached > 1.0F - kGap) floorAt(i, side) = floor;
  }

  /// Ends as coarse as the coarser sample beyond the side, where that one keeps its weight for it.
  void meetCoarser(std::uint32_t i, int side) {
    for (const std::uint32_t j : neighbours_[i]) {
      if (density(j) >= density(i) || fades_[j] <= 0.0F) continue;
      for (int b = 0; b < 4; ++b) {
        const float kept = floorAt(j, b);
        if (kept <= 0.0F || !liesBeyond(*samples_[i], *samples_[j], b)) continue;
        if (!partOfSide(*samples_[i], side, *samples_[j], b)) continue;
        floorAt(i, side) = std::min(1.0F, kept * fades_[j] / fades_[i]);
        borders_[i].beyond[componentOf(side)] = std::log2(density(i) / density(j));
        return;
      }
    }
  }

  /// Lets the sample fade out over coarser ones that lie under it and go on beyond a side.
  void lieOverCoarser(std::uint32_t i) {
    for (const std::uint32_t j : nesting_.coarser[i]) borders_[i].under = std::max(borders_[i].under, fades_[j]);
    for (int side = 0; side < 4; ++side) {
      if (floorAt(i, side) > 0.0F) continue;
      float goes_on = 0.0F;
      for (const std::uint32_t j : nesting_.coarser[i])
        goes_on = std::max(goes_on, fades_[j] * shareAcross(i, side, j));
      borders_[i].beyond[componentOf(side)] = -std::min(1.0F, goes_on);
    }
  }

  /// Returns the share of its weight that the coarser sample j, in which i lies, keeps across a side of i.
  float shareAcross(std::uint32_t i, int side, std::uint32_t j) {
    for (int b = 0; b < 4; ++b)
      if (partOfSide(*samples_[i], side, *samples_[j], b)) return floorAt(j, b);
    return 1.0F;
  }

  std::span<const SampleGeometry* const> samples_;
  std::span<const float> fades_;
  const SampleNesting& nesting_;
  std::vector<SampleBorders> borders_;
  std::vector<std::vector<std::uint32_t>> neighbours_;  // of the same centre
};

}  // namespace

std::vector<SampleBorders> bordersOf(std::span<const SampleGeometry* const> samples, std::span<const float> fades,
                                     const SampleNesting& nesting) {
  return Borders(samples, fades, nesting).take();
}

}  // namespace client
