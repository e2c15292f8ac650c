#include "lod/texture/coverage.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace lod::texture {
namespace {

struct Interval {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();

  void include(double x) {
    min = std::min(min, x);
    max = std::max(max, x);
  }
};

// A triangle's edges, each with its x as it changes with y.
struct Edges {
  struct Edge {
    glm::dvec2 a{0.0};
    double end = 0.0;    // the y of the other corner
    double slope = 0.0;  // of x, where the edge is not level
  };
  std::array<Edge, 3> all;

  explicit Edges(const std::array<glm::dvec2, 3>& corners) {
    for (int i = 0; i < 3; ++i) {
      const glm::dvec2 &a = corners[i], &b = corners[(i + 1) % 3];
      all[i] = {a, b.y, a.y == b.y ? 0.0 : (b.x - a.x) / (b.y - a.y)};
    }
  }
  // Returns the x of the triangle's points between two heights; min is above max where there are none.
  Interval slice(double low, double high) const {
    Interval slice;
    for (const auto& [a, end, slope] : all) {
      if (a.y >= low && a.y <= high) slice.include(a.x);
      if ((a.y < low) != (end < low)) slice.include(a.x + slope * (low - a.y));
      if ((a.y < high) != (end < high)) slice.include(a.x + slope * (high - a.y));
    }
    return slice;
  }
};

// Returns a number within 0 … `end`.
int clamped(double value, int end) {
  return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(end)));
}

}  // namespace

void coverTriangle(const std::array<glm::dvec2, 3>& corners, double reach, const MaskView& mask) {
  const auto [least, greatest] = std::minmax({corners[0].y, corners[1].y, corners[2].y});

  const Edges edges(corners);
  // Row r has its centres at r + 1/2; likewise for columns.
  const int end = clamped(std::floor(greatest + reach - 0.5) + 1.0, mask.height);
  for (int r = clamped(std::ceil(least - reach - 0.5), mask.height); r < end; ++r) {
    const Interval slice = edges.slice(r + 0.5 - reach, r + 0.5 + reach);
    const int first = clamped(std::ceil(slice.min - reach - 0.5), mask.width);
    const int last = clamped(std::floor(slice.max + reach - 0.5) + 1.0, mask.width);
    if (first < last) std::memset(mask.row(r) + first, 1, static_cast<std::size_t>(last - first));
  }
}

}  // namespace lod::texture
