#pragma once
// Points in a uniform grid, for nearest searches within one group.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <vector>

namespace lod::patch::builder {

class PointGrid {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  /// Holds positions[i] for every i in `members`, about one point in a cell.
  PointGrid(std::span<const glm::vec3> positions, std::span<const std::uint32_t> members) : positions_(positions) {
    // Cells have equal sides; there are at most about twice as many as points.
    glm::vec3 low(std::numeric_limits<float>::max());
    glm::vec3 high(std::numeric_limits<float>::lowest());
    for (const std::uint32_t m : members) low = glm::min(low, positions[m]), high = glm::max(high, positions[m]);
    const glm::vec3 size = members.empty() ? glm::vec3(1.0F) : high - low;
    low_ = low;
    const float longest = std::max({size.x, size.y, size.z, 1.0F});
    cell_ = longest / std::cbrt(static_cast<float>(members.size()) + 1.0F);
    for (;; cell_ *= 0.7F) {
      const glm::ivec3 finer = glm::ivec3(size / (0.7F * cell_)) + 1;
      count_ = glm::ivec3(size / cell_) + 1;
      const double cells = static_cast<double>(finer.x) * finer.y * finer.z;
      if (cells > 2.0 * static_cast<double>(members.size()) + 8.0) break;
    }

    // Counting sort.
    start_.assign(
        static_cast<std::size_t>(count_.x) * static_cast<std::size_t>(count_.y) * static_cast<std::size_t>(count_.z) +
            1,
        0);
    for (const std::uint32_t m : members) ++start_[cellNumber(cellOf(positions[m])) + 1];
    for (std::size_t c = 1; c < start_.size(); ++c) start_[c] += start_[c - 1];
    members_.resize(members.size());
    std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
    for (const std::uint32_t m : members) members_[next[cellNumber(cellOf(positions[m]))]++] = m;
  }

  /// The member nearest to p for which accept(member) holds, or kNone. The search ends at any member within a squared
  /// distance of `enough2`.
  template <class Accept>
  std::uint32_t nearest(const glm::vec3& p, Accept&& accept, float enough2 = 0.0F) const {
    const glm::ivec3 center = cellOf(p);
    // A point outside the grid starts from the nearest cell, so rings are farther from it than `reach` says.
    const int rings = std::max({count_.x, count_.y, count_.z});
    std::uint32_t best = kNone;
    float best2 = std::numeric_limits<float>::max();
    for (int ring = 0; ring <= rings; ++ring) {
      const float reach = static_cast<float>(ring - 1) * cell_;
      if (best2 <= enough2 || (best != kNone && reach > 0.0F && reach * reach > best2)) break;
      forRing(center, ring, [&](std::size_t cell) {
        for (std::uint32_t i = start_[cell]; i < start_[cell + 1]; ++i) {
          const glm::vec3 d = positions_[members_[i]] - p;
          const float d2 = glm::dot(d, d);
          if (d2 < best2 && accept(members_[i])) best2 = d2, best = members_[i];
        }
      });
    }
    return best;
  }

 private:
  glm::ivec3 cellOf(const glm::vec3& p) const {
    return glm::clamp(glm::ivec3(glm::clamp((p - low_) / cell_, -1.0F, 1e6F)), glm::ivec3(0), count_ - 1);
  }
  std::size_t cellNumber(const glm::ivec3& c) const {
    return (static_cast<std::size_t>(c.z) * static_cast<std::size_t>(count_.y) + static_cast<std::size_t>(c.y)) *
               static_cast<std::size_t>(count_.x) +
           static_cast<std::size_t>(c.x);
  }
  // Calls body(cell) for the cells of the grid at Chebyshev distance `ring`.
  template <class Body>
  void forRing(const glm::ivec3& center, int ring, Body&& body) const {
    for (int z = std::max(0, center.z - ring); z <= std::min(count_.z - 1, center.z + ring); ++z) {
      for (int y = std::max(0, center.y - ring); y <= std::min(count_.y - 1, center.y + ring); ++y) {
        const bool face = std::abs(z - center.z) == ring || std::abs(y - center.y) == ring;
        const int step = face || ring == 0 ? 1 : 2 * ring;
        for (int x = center.x - ring; x <= center.x + ring; x += step)
          if (x >= 0 && x < count_.x) body(cellNumber({x, y, z}));
      }
    }
  }

  std::span<const glm::vec3> positions_;
  glm::vec3 low_{0.0F};
  float cell_ = 1.0F;
  glm::ivec3 count_{1};
  std::vector<std::uint32_t> start_;
  std::vector<std::uint32_t> members_;
};

}  // namespace lod::patch::builder
