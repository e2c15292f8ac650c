#include "lod/texture/page_plan.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "lod/texture/packing.h"
#include "lod/texture/wrapped.h"

namespace lod::texture {
namespace {

// A call's charts have at most so many texels together: those of two pictures, but four pages at least, and at most the
// largest picture that readers take (16384 × 16384). This bounds memory and time for triangles that each cover all of a
// picture at another place.
constexpr std::int64_t kMinLimit = std::int64_t{1} << 26, kMaxLimit = std::int64_t{1} << 28;
std::int64_t texelLimit(const glm::ivec2& picture) {
  return std::clamp(2 * std::int64_t{picture.x} * picture.y, kMinLimit, kMaxLimit);
}

// Around a chart there is one texel of the picture, which look-ups in the full level read.
constexpr int kMargin = 1;
constexpr int kMinGrain = 2;
// Sides of pages are multiples of it, so that rows of RGB are multiples of four bytes.
constexpr int kSideMultiple = 4;

int roundedUp(int value, int multiple) {
  return (value + multiple - 1) / multiple * multiple;
}
glm::ivec2 roundedUp(const glm::ivec2& value, int multiple) {
  return {roundedUp(value.x, multiple), roundedUp(value.y, multiple)};
}
std::int64_t areaOf(const glm::ivec2& size) {
  return std::int64_t{size.x} * size.y;
}
int longest(const glm::ivec2& size) {
  return std::max(size.x, size.y);
}

int padding(int grain) {
  return kMargin + grain / 2;
}
glm::ivec2 slotSize(const glm::ivec2& chart, int grain) {
  return roundedUp(chart + 2 * padding(grain), grain);
}

// By how much a slot may be longer than one without units.
int unitExcess(const glm::ivec2& unit) {
  return unit == glm::ivec2(1) ? 0 : 2 * longest(unit);
}
// The least padding from `least` on that moves a chart by a multiple of the unit, in a slot that begins at one.
glm::ivec2 unitPadding(const Chart& chart, int least, const glm::ivec2& unit) {
  const glm::ivec2 offset = chart.min - least;
  return least + glm::ivec2(wrapped(offset.x, unit.x), wrapped(offset.y, unit.y));
}

// The least factor at which all charts together have at most `limit` texels, or one each.
int commonFactor(const std::vector<Chart>& charts, std::int64_t limit) {
  for (int factor = 1;; ++factor) {
    std::int64_t texels = 0;
    for (const Chart& chart : charts) texels += areaOf(reducedSize(chart, factor));
    if (texels <= limit || texels <= static_cast<std::int64_t>(charts.size())) return factor;
  }
}

// The mean edge, in texels of the page, of triangles that are not points.
double meanEdge(const std::vector<Chart>& charts, const std::vector<std::uint32_t>& chosen, int factor) {
  double sum = 0.0;
  std::uint64_t count = 0;
  for (const std::uint32_t chart : chosen) {
    for (const StepTriangle& triangle : charts[chart].triangles) {
      for (int i = 0; i < 3; ++i) {
        const double length = glm::length(glm::dvec2(triangle.corners[(i + 1) % 3] - triangle.corners[i]));
        sum += length;
        count += length > 0.0 ? 1 : 0;
      }
    }
  }
  return count == 0 ? 0.0 : sum / (static_cast<double>(count) * kCornerSteps * factor);
}

bool grainSuits(const std::vector<glm::ivec2>& sizes, int grain, int max_side) {
  std::int64_t slots = 0, charts = 0;
  for (const glm::ivec2& size : sizes) {
    const glm::ivec2 slot = slotSize(size, grain);
    if (longest(slot) > max_side / std::max(grain, kSideMultiple) * std::max(grain, kSideMultiple)) return false;
    slots += areaOf(slot);
    charts += areaOf(size + 2 * kMargin);
  }
  return 3 * slots <= 4 * charts;
}

int chooseGrain(const std::vector<glm::ivec2>& sizes, double mean_edge, int max_side) {
  int grain = kMinGrain;
  while (grain * std::sqrt(2.0) < mean_edge) grain *= 2;  // the power of two that is nearest by its ratio
  while (grain > kMinGrain && !grainSuits(sizes, grain, max_side)) grain /= 2;
  return grain;
}

PagePlan planAlone(const std::vector<Chart>& charts, std::uint32_t chart, int factor, int max_side,
                   const glm::ivec2& unit) {
  while (longest(reducedSize(charts[chart], factor)) > max_side) ++factor;
  const glm::ivec2 size = reducedSize(charts[chart], factor);
  const glm::ivec2 margin = glm::min(glm::ivec2(kMargin), (max_side - size) / 2);
  PagePlan page;
  const bool in_units = unit != glm::ivec2(1);
  const int multiple = in_units ? longest(unit) : kSideMultiple;
  glm::ivec2 before = margin, after = margin;
  for (int k = 0; in_units && k < 2; ++k) {
    before[k] = unitPadding(charts[chart], kMargin, unit)[k];
    after[k] = kMargin;
    if (roundedUp(before[k] + size[k] + after[k], multiple) <= max_side) continue;
    before[k] = unitPadding(charts[chart], 0, unit)[k];
    after[k] = 0;
  }
  page.size = roundedUp(before + size + after, multiple);
  page.factor = factor;
  page.levels = static_cast<std::uint32_t>(std::bit_width(static_cast<unsigned>(longest(page.size))));
  page.slots.push_back({chart, glm::ivec2(0), page.size, before});
  return page;
}

// Packs charts into common pages.
void planTogether(const std::vector<Chart>& charts, const std::vector<std::uint32_t>& chosen, int factor, int max_side,
                  const glm::ivec2& unit, std::vector<PagePlan>& pages) {
  std::vector<glm::ivec2> sizes, origins;
  sizes.reserve(chosen.size());
  for (const std::uint32_t chart : chosen) sizes.push_back(reducedSize(charts[chart], factor));
  const int grain = chooseGrain(sizes, meanEdge(charts, chosen, factor), max_side - unitExcess(unit));

  // Rectangles are packed in cells: grains, or units where these are larger.
  const int cell = std::max({grain, unit.x, unit.y});
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    origins.push_back(unitPadding(charts[chosen[i]], padding(grain), unit));
    sizes[i] = roundedUp(origins[i] + sizes[i] + padding(grain), cell) / cell;
  }
  const int multiple = std::max(1, kSideMultiple / cell);
  const int side = max_side / cell / multiple * multiple;
  for (const PackedPage& packed : packRectangles(sizes, side, multiple)) {
    PagePlan& page = pages.emplace_back();
    page.size = packed.size * cell;
    page.factor = factor;
    page.levels = static_cast<std::uint32_t>(std::bit_width(static_cast<unsigned>(grain)));
    page.grain = cell;
    for (const PackedRectangle& slot : packed.rectangles)
      page.slots.push_back(
          {chosen[slot.index], slot.place * cell, sizes[slot.index] * cell, slot.place * cell + origins[slot.index]});
  }
}

std::vector<PagePlan> planAtFactor(const std::vector<Chart>& charts, int factor, int max_side, const glm::ivec2& unit) {
  std::vector<PagePlan> pages;
  std::vector<std::uint32_t> together, alone;
  for (std::uint32_t c = 0; c < charts.size(); ++c)
    (longest(slotSize(reducedSize(charts[c], factor), kMinGrain)) > max_side - unitExcess(unit) ? alone : together)
        .push_back(c);
  if (together.size() == 1) {
    alone.push_back(together[0]);
    together.clear();
  }
  if (!together.empty()) planTogether(charts, together, factor, max_side, unit, pages);
  for (const std::uint32_t chart : alone) pages.push_back(planAlone(charts, chart, factor, max_side, unit));
  return pages;
}

std::int64_t areaOf(const std::vector<PagePlan>& pages) {
  std::int64_t area = 0;
  for (const PagePlan& page : pages) area += areaOf(page.size);
  return area;
}

}  // namespace

std::vector<PagePlan> planPages(const std::vector<Chart>& charts, const glm::ivec2& picture, int max_side,
                                const glm::ivec2& unit) {
  const int factor = commonFactor(charts, texelLimit(picture));
  auto pages = planAtFactor(charts, factor, max_side, glm::ivec2(1));
  if (unit == glm::ivec2(1)) return pages;

  for (const PagePlan& page : pages)
    if (page.factor > 1) return {};
  auto in_units = planAtFactor(charts, 1, max_side, unit);
  for (const PagePlan& page : in_units)
    if (page.factor > 1 || longest(page.size) > max_side) return {};
  const bool small = static_cast<double>(areaOf(in_units)) <=
                     kMostUnitArea * static_cast<double>(areaOf(pages)) + static_cast<double>(kSmallArea);
  return small ? std::move(in_units) : std::vector<PagePlan>();
}

void placeTriangles(const Chart& chart, const PagePlan& plan, const Slot& slot, std::vector<PageTriangle>& placed) {
  for (const StepTriangle& triangle : chart.triangles) {
    PageTriangle& added = placed.emplace_back();
    added.triangle = triangle.triangle;
    for (int i = 0; i < 3; ++i) {
      const glm::ivec2 steps = triangle.corners[i] - chart.min * kCornerSteps;
      const glm::ivec2 rounded = (2 * steps + plan.factor) / (2 * plan.factor);
      // The right edge of the longest page would be step 65536.
      added.corners[i] = glm::u16vec2(glm::min(rounded + slot.origin * kCornerSteps, 65535));
    }
  }
}

}  // namespace lod::texture
