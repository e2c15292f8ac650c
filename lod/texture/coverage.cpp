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

// Returns the x of the triangle's points between two heights; min is above max where there are none.
Interval sliceOf(const std::array<glm::dvec2, 3>& corners, double low, double high) {
  Interval slice;
  for (int i = 0; i < 3; ++i) {
    const glm::dvec2& a = corners[i];
    const glm::dvec2& b = corners[(i + 1) % 3];
    if (a.y >= low && a.y <= high) slice.include(a.x);
    for (const double y : {low, high})
      if ((a.y < y) != (b.y < y)) slice.include(a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y)));
  }
  return slice;
}

// Returns a number within 0 … `end`.
int clamped(double value, int end) {
  return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(end)));
}

}  // namespace

void coverTriangle(const std::array<glm::dvec2, 3>& corners, double reach, const MaskView& mask) {
  const auto [least, greatest] = std::minmax({corners[0].y, corners[1].y, corners[2].y});

  // Row r has its centres at r + 1/2; likewise for columns.
  const int end = clamped(std::floor(greatest + reach - 0.5) + 1.0, mask.height);
  for (int r = clamped(std::ceil(least - reach - 0.5), mask.height); r < end; ++r) {
    const Interval slice = sliceOf(corners, r + 0.5 - reach, r + 0.5 + reach);
    const int first = clamped(std::ceil(slice.min - reach - 0.5), mask.width);
    const int last = clamped(std::floor(slice.max + reach - 0.5) + 1.0, mask.width);
    if (first < last) std::memset(mask.row(r) + first, 1, static_cast<std::size_t>(last - first));
  }
}

}  // namespace lod::texture
