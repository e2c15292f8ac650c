#include "lod/texture/page.h"

#include <algorithm>
#include <cstring>

#include "base/check.h"
#include "lod/texture/charts.h"
#include "lod/texture/coverage.h"
#include "lod/texture/fill.h"
#include "lod/texture/page_plan.h"
#include "lod/texture/wrapped.h"

namespace lod::texture {
namespace {

constexpr int kMinSide = 64, kMaxPictureSide = 1 << 20;  // texels; larger sides would not fit the arithmetic
// A texel of a reduced page is the mean of at most so many texels of the picture a side, evenly spaced: more would take
// long for a picture that repeats hundreds of times, and change nothing to be seen.
constexpr int kMaxSamples = 8;

// A page in the making.
struct Canvas {
  const base::Image& picture;
  base::Image image;
  std::vector<std::uint8_t> mask;

  MaskView maskAt(const glm::ivec2& at, const glm::ivec2& size) {
    const std::ptrdiff_t offset = std::ptrdiff_t{at.y} * image.width + at.x;
    return {mask.data() + offset, image.width, size.x, size.y};
  }
  FillView fillAt(const glm::ivec2& at, const glm::ivec2& size) {
    return {image.at(at.x, at.y), std::ptrdiff_t{image.width} * image.channels, image.channels, maskAt(at, size)};
  }
};

// Copies texels of the picture, which repeats, from column x on.
void copyRow(const base::Image& picture, int x, int y, int count, std::uint8_t* out) {
  const int row = wrapped(y, picture.height);
  for (int from = wrapped(x, picture.width); count > 0; from = 0) {
    const int run = std::min(count, picture.width - from);
    const std::size_t bytes = static_cast<std::size_t>(run) * static_cast<std::size_t>(picture.channels);
    std::memcpy(out, picture.at(from, row), bytes);
    out += bytes;
    count -= run;
  }
}

// Cuts a chart out at the picture's resolution.
void copyChart(const Chart& chart, const Slot& slot, Canvas& canvas) {
  const glm::ivec2 slot_at = chart.min - (slot.origin - slot.min);  // the slot's least corner in the picture
  const MaskView mask = canvas.maskAt(slot.min, slot.size);
  for (const StepTriangle& triangle : chart.triangles) {
    std::array<glm::dvec2, 3> corners;
    for (int i = 0; i < 3; ++i)
      corners[i] = glm::dvec2(triangle.corners[i] - slot_at * kCornerSteps) / double{kCornerSteps};
    coverTriangle(corners, kLookUpReach, mask);
  }

  const glm::ivec2 first = glm::max(slot.origin - 1, slot.min);
  const glm::ivec2 end = glm::min(slot.origin + chart.size() + 1, slot.min + slot.size);
  for (int y = first.y; y < end.y; ++y)
    copyRow(canvas.picture, slot_at.x + first.x - slot.min.x, slot_at.y + y - slot.min.y, end.x - first.x,
            canvas.image.at(first.x, y));
}

// Cuts a chart out at a lower resolution, row by row. A texel is the mean of samples that triangles need.
class ChartReduction {
 public:
  ChartReduction(const Chart& chart, const PagePlan& page, const Slot& slot, Canvas& canvas)
      : chart_(chart),
        slot_(slot),
        canvas_(canvas),
        factor_(page.factor),
        samples_(std::min(page.factor, kMaxSamples)) {
    columns_.resize(static_cast<std::size_t>(slot.size.x) * static_cast<std::size_t>(samples_));
    for (int x = 0; x < static_cast<int>(columns_.size()); ++x)
      columns_[x] = wrapped(pictureOf(x, chart.min.x, slot.origin.x - slot.min.x), canvas.picture.width);
    covered_.resize(columns_.size() * static_cast<std::size_t>(samples_));
    const glm::dvec2 slot_at = glm::dvec2(chart.min) - glm::dvec2(slot.origin - slot.min) * double(factor_);
    for (const StepTriangle& triangle : chart.triangles) {
      std::array<glm::dvec2, 3>& corners = triangles_.emplace_back();
      for (int i = 0; i < 3; ++i)
        corners[i] = (glm::dvec2(triangle.corners[i]) / double{kCornerSteps} - slot_at) * (double(samples_) / factor_);
    }
  }

  // Texels beside the chart are not mixed in, unless the chart has none of its own.
  void cut() {
    for (const double reach : {kInsideReach, kLookUpReach}) {
      found_ = false;
      for (int y = 0; y < slot_.size.y; ++y) cutRow(y, reach);
      if (found_) return;
    }
  }

 private:
  void cutRow(int y, double reach) {
    const MaskView strip{covered_.data(), static_cast<std::ptrdiff_t>(columns_.size()),
                         static_cast<int>(columns_.size()), samples_};
    std::fill(covered_.begin(), covered_.end(), std::uint8_t{0});
    const glm::dvec2 down(0.0, double(y) * samples_);
    for (const auto& [a, b, c] : triangles_) {
      const auto [least, greatest] = std::minmax({a.y, b.y, c.y});
      if (greatest < down.y - 2.0 || least > down.y + samples_ + 2.0) continue;
      coverTriangle({a - down, b - down, c - down}, reach, strip);
    }
    std::array<const std::uint8_t*, kMaxSamples> rows{};
    for (int i = 0; i < samples_; ++i) {
      const int row = pictureOf(y * samples_ + i, chart_.min.y, slot_.origin.y - slot_.min.y);
      rows[i] = canvas_.picture.at(0, wrapped(row, canvas_.picture.height));
    }
    for (int x = 0; x < slot_.size.x; ++x) writeMean(rows, strip, x, y);
  }

  // Returns the picture's column (or row) of sample `sample` of the slot, whose chart begins at texel `origin` of it.
  int pictureOf(int sample, int chart_min, int origin) const {
    const int texel = sample / samples_, within = sample % samples_;
    return chart_min + (texel - origin) * factor_ + (2 * within + 1) * factor_ / (2 * samples_);
  }

  void writeMean(const std::array<const std::uint8_t*, kMaxSamples>& rows, const MaskView& strip, int x, int y) {
    const int channels = canvas_.image.channels;
    std::array<unsigned, 4> sum{};
    unsigned count = 0;
    for (int i = 0; i < samples_; ++i) {
      for (int j = x * samples_; j < (x + 1) * samples_; ++j) {
        if (strip.row(i)[j] == 0) continue;
        const std::uint8_t* texel = rows[i] + std::ptrdiff_t{columns_[j]} * channels;
        for (int c = 0; c < channels; ++c) sum[c] += texel[c];
        ++count;
      }
    }
    if (count == 0) return;
    const glm::ivec2 at = slot_.min + glm::ivec2(x, y);
    for (int c = 0; c < channels; ++c)
      canvas_.image.at(at.x, at.y)[c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
    *canvas_.maskAt(at, {1, 1}).texels = 1;
    found_ = true;
  }

  const Chart& chart_;
  const Slot& slot_;
  Canvas& canvas_;
  const int factor_, samples_;
  bool found_ = false;        // a texel with a sample of the chart
  std::vector<int> columns_;  // of the picture, one for each sample of a row
  std::vector<std::uint8_t> covered_;
  std::vector<std::array<glm::dvec2, 3>> triangles_;  // in samples of the slot
};

// Fills what is left between the slots from the slots beside it. Free places are multiples of the grain too.
void fillFreePlaces(const PagePlan& page, Canvas& canvas) {
  const glm::ivec2 cells = page.size / page.grain;
  base::Image coarse(cells.x, cells.y, canvas.image.channels);
  std::vector<std::uint8_t> mask(static_cast<std::size_t>(cells.x) * static_cast<std::size_t>(cells.y));
  const auto channels = static_cast<std::size_t>(coarse.channels);
  for (const Slot& slot : page.slots) {
    const glm::ivec2 first = slot.min / page.grain, end = first + slot.size / page.grain;
    for (int y = first.y; y < end.y; ++y) {
      for (int x = first.x; x < end.x; ++x) {
        const glm::ivec2 middle = glm::ivec2(x, y) * page.grain + page.grain / 2;
        std::memcpy(coarse.at(x, y), canvas.image.at(middle.x, middle.y), channels);
      }
      std::memset(
          &mask[static_cast<std::size_t>(y) * static_cast<std::size_t>(cells.x) + static_cast<std::size_t>(first.x)], 1,
          static_cast<std::size_t>(end.x - first.x));
    }
  }

  fillUncovered({coarse.pixels.data(),
                 std::ptrdiff_t{cells.x} * coarse.channels,
                 coarse.channels,
                 {mask.data(), cells.x, cells.x, cells.y}});
  for (int y = 0; y < page.size.y; ++y) {
    const int row = y / page.grain;
    for (int x = 0; x < cells.x; ++x) {
      if (mask[static_cast<std::size_t>(row) * static_cast<std::size_t>(cells.x) + static_cast<std::size_t>(x)] == 1)
        continue;
      for (int i = x * page.grain; i < (x + 1) * page.grain; ++i)
        std::memcpy(canvas.image.at(i, y), coarse.at(x, row), channels);
    }
  }
}

// Drops the alpha if it says nothing where triangles are.
void dropOpaqueAlpha(Canvas& canvas) {
  base::Image& image = canvas.image;
  if (image.channels != 4) return;
  for (std::size_t i = 0; i < canvas.mask.size(); ++i)
    if (canvas.mask[i] == 1 && image.pixels[4 * i + 3] != 255) return;
  base::Image rgb(image.width, image.height, 3);
  for (std::size_t i = 0; i < canvas.mask.size(); ++i) std::memcpy(&rgb.pixels[3 * i], &image.pixels[4 * i], 3);
  image = std::move(rgb);
}

Page drawPage(const base::Image& picture, const std::vector<Chart>& charts, const PagePlan& plan) {
  Page page;
  page.levels = plan.levels;
  page.scale = 1.0F / static_cast<float>(plan.factor);
  Canvas canvas{picture, base::Image(plan.size.x, plan.size.y, picture.channels), {}};
  canvas.mask.resize(static_cast<std::size_t>(plan.size.x) * static_cast<std::size_t>(plan.size.y));
  for (const Slot& slot : plan.slots) {
    const Chart& chart = charts[slot.chart];
    if (plan.factor == 1) {
      copyChart(chart, slot, canvas);
    } else {
      ChartReduction(chart, plan, slot, canvas).cut();
    }
    fillUncovered(canvas.fillAt(slot.min, slot.size));
    placeTriangles(chart, plan, slot, page.triangles);
  }
  if (plan.slots.size() > 1) fillFreePlaces(plan, canvas);
  dropOpaqueAlpha(canvas);
  page.image = std::move(canvas.image);
  std::sort(page.triangles.begin(), page.triangles.end(),
            [](const PageTriangle& a, const PageTriangle& b) { return a.triangle < b.triangle; });
  return page;
}

}  // namespace

std::vector<Page> makePages(const base::Image& picture, std::span<const PictureTriangle> triangles, int max_side) {
  LUMIGRID_CHECK(picture.channels == 3 || picture.channels == 4);
  LUMIGRID_CHECK(!picture.empty() && std::max(picture.width, picture.height) <= kMaxPictureSide);
  LUMIGRID_CHECK(max_side >= kMinSide && max_side <= kMaxPageSide);
  const glm::ivec2 size(picture.width, picture.height);
  const std::vector<Chart> charts = foldRepetitions(findCharts(roundTriangles(triangles)), size);
  std::vector<Page> pages;
  if (charts.empty()) return pages;
  for (const PagePlan& plan : planPages(charts, size, max_side / 4 * 4))
    pages.push_back(drawPage(picture, charts, plan));
  return pages;
}

}  // namespace lod::texture
