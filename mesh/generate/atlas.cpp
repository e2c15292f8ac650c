#include "mesh/generate/atlas.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mesh::generate {
namespace {

constexpr std::size_t kMaxPictures = 10'000;  // 160 billion texels; a choice
constexpr std::size_t kOpenPictures = 16;     // the last pictures, which are tried for a chart; a choice

/// The lines at which a sheet is cut, its first and last ones included.
struct Cut {
  std::vector<std::uint32_t> lines;
  bool fits = true;  ///< false where one column of quads alone is wider than a picture
};

// Cuts lines into pieces of about equal length of at most `max_length`.
Cut cutLines(const std::vector<double>& lines, std::uint32_t min_pieces, double max_length) {
  const double length = lines.back() - lines.front();
  const auto last = static_cast<std::uint32_t>(lines.size() - 1);
  auto pieces = std::min(last, std::max(min_pieces, static_cast<std::uint32_t>(length / max_length) + 1));
  for (; pieces <= last; ++pieces) {
    Cut cut{{0}};
    for (std::uint32_t k = 1; k < pieces; ++k) {
      // The line nearest to where the piece should end leaves one line at least for each piece to come.
      const double at = lines.front() + length * k / static_cast<double>(pieces);
      auto line = static_cast<std::uint32_t>(std::lower_bound(lines.begin(), lines.end(), at) - lines.begin());
      if (line > 0 && at - lines[line - 1] < lines[line] - at) --line;
      cut.lines.push_back(std::clamp(line, cut.lines.back() + 1, last - (pieces - k)));
    }
    cut.lines.push_back(last);
    double longest = 0.0;
    for (std::size_t k = 0; k + 1 < cut.lines.size(); ++k)
      longest = std::max(longest, lines[cut.lines[k + 1]] - lines[cut.lines[k]]);
    if (longest <= max_length) return cut;
  }
  return {{0, last}, false};
}

bool hasQuads(const TexturedSurface& surface, const Chart& chart) {
  for (std::uint32_t j = chart.bottom; j < chart.top; ++j)
    for (std::uint32_t i = chart.left; i < chart.right; ++i)
      if (surface.hasQuad(chart.sheet, i, j)) return true;
  return false;
}

// Every fourth chart is turned and every third one mirrored. The result says whether all charts fit into pictures.
bool addCharts(const TexturedSurface& surface, std::uint32_t number, Atlas& atlas) {
  const Sheet& sheet = surface.sheets()[number];
  const double max_length = (kMaxPictureSide - 2 * (atlas.style.padding + atlas.style.gap) - 1) / atlas.density;
  const Cut across = cutLines(sheet.s, sheet.min_pieces, max_length);
  const Cut upwards = cutLines(sheet.t, sheet.min_pieces, max_length);
  for (std::size_t j = 0; j + 1 < upwards.lines.size(); ++j)
    for (std::size_t i = 0; i + 1 < across.lines.size(); ++i) {
      Chart chart;
      chart.sheet = number;
      chart.left = across.lines[i], chart.right = across.lines[i + 1];
      chart.bottom = upwards.lines[j], chart.top = upwards.lines[j + 1];
      chart.low = {sheet.s[chart.left], sheet.t[chart.bottom]};
      chart.size = glm::dvec2(sheet.s[chart.right], sheet.t[chart.top]) - chart.low;
      chart.turned = atlas.style.turns_charts && atlas.charts.size() % 4 == 1;
      chart.mirrored = atlas.style.turns_charts && atlas.charts.size() % 3 == 2;
      if (hasQuads(surface, chart)) atlas.charts.push_back(chart);
    }
  return across.fits && upwards.fits;
}

/// The lower border of all that lies in a picture so far, as steps from left to right. Charts are placed beneath it.
class Skyline {
 public:
  explicit Skyline(int gap) : gap_(gap), steps_{{gap, gap}} {}

  /// The place nearest to the top for a chart and the gap after it, and the leftmost of such; y is −1 where none is.
  glm::ivec2 placeFor(const glm::ivec2& extent) const {
    glm::ivec2 best(0, -1);
    for (std::size_t i = 0; i < steps_.size(); ++i) {
      const int left = steps_[i].x, right = left + extent.x + gap_;
      if (right > kMaxPictureSide) break;
      int top = 0;
      for (std::size_t k = i; k < steps_.size() && steps_[k].x < right; ++k) top = std::max(top, steps_[k].y);
      if (top + extent.y + gap_ <= kMaxPictureSide && (best.y < 0 || top < best.y)) best = {left, top};
    }
    return best;
  }

  void cover(const glm::ivec2& place, const glm::ivec2& extent) {
    const int left = place.x, right = place.x + extent.x + gap_;
    std::vector<glm::ivec2> steps;
    int ground = gap_;  // of the last step that begins at or before the right end
    for (const glm::ivec2& step : steps_) {
      if (step.x < left || step.x > right) steps.push_back(step);
      if (step.x <= right) ground = step.y;
    }
    const auto at = std::find_if(steps.begin(), steps.end(), [&](const glm::ivec2& step) { return step.x > left; });
    steps.insert(at, {{left, place.y + extent.y + gap_}, {right, ground}});
    steps_ = std::move(steps);
  }

 private:
  int gap_;
  std::vector<glm::ivec2> steps_;  // x where it begins, and y of the free texels beneath
};

// Places the highest charts first. A picture is as wide and high as its charts need.
void placeInPictures(Atlas& atlas) {
  const int gap = atlas.style.gap;
  std::vector<std::size_t> order(atlas.charts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return atlas.extent(atlas.charts[a]).y > atlas.extent(atlas.charts[b]).y;
  });
  std::vector<Skyline> skylines;
  for (const std::size_t number : order) {
    Chart& chart = atlas.charts[number];
    const glm::ivec2 extent = atlas.extent(chart);
    std::size_t picture = skylines.size() < kOpenPictures ? 0 : skylines.size() - kOpenPictures;
    glm::ivec2 place(0, -1);
    for (; picture < skylines.size(); ++picture)
      if (place = skylines[picture].placeFor(extent); place.y >= 0) break;
    if (picture == skylines.size()) {
      skylines.emplace_back(gap);
      atlas.pictures.emplace_back(0, 0);
      place = glm::ivec2(gap);
    }
    skylines[picture].cover(place, extent);
    chart.picture = static_cast<std::uint32_t>(picture);
    chart.place = place;
    atlas.pictures[picture] = glm::max(atlas.pictures[picture], place + extent + gap);
  }
}

}  // namespace

glm::ivec2 Atlas::extent(const Chart& chart) const {
  const glm::ivec2 texels = glm::ivec2(glm::ceil(density * chart.size)) + 2 * style.padding;
  return chart.turned ? glm::ivec2(texels.y, texels.x) : texels;
}

glm::dvec2 Atlas::pictureFromSheet(const Chart& chart, const glm::dvec2& st) const {
  // Upright, rows run down from the chart's top. Turned, its right side is up and its upper side is left.
  const glm::dvec2 beyond = density * (chart.low + chart.size - st);
  glm::dvec2 at = chart.turned ? glm::dvec2(beyond.y, beyond.x) : glm::dvec2(density * (st.x - chart.low.x), beyond.y);
  if (chart.mirrored) at.x = density * (chart.turned ? chart.size.y : chart.size.x) - at.x;
  return at + glm::dvec2(chart.place + style.padding);
}

glm::dvec2 Atlas::sheetFromPicture(const Chart& chart, const glm::dvec2& at) const {
  glm::dvec2 texels = at - glm::dvec2(chart.place + style.padding);
  if (chart.mirrored) texels.x = density * (chart.turned ? chart.size.y : chart.size.x) - texels.x;
  const glm::dvec2 high = chart.low + chart.size;
  if (chart.turned) return high - glm::dvec2(texels.y, texels.x) / density;
  return {chart.low.x + texels.x / density, high.y - texels.y / density};
}

base::Result<Atlas> makeAtlas(const TexturedSurface& surface, std::uint64_t texels) {
  Atlas atlas;
  atlas.style = surface.atlasStyle();
  const double wanted = static_cast<double>(surface.triangleCount()) * static_cast<double>(texels);
  atlas.density = std::sqrt(wanted / surface.area()) * (1.0 + 1e-9);  // rounding must not take it below
  const auto tooMany = [&] {
    return base::Error{base::ErrorCode::kInvalidInput, std::to_string(static_cast<std::uint64_t>(wanted)) +
                                                           " texels: at most " + std::to_string(kMaxPictures) +
                                                           " pictures are written; ask for fewer triangles or texels"};
  };
  if (wanted / (double{kMaxPictureSide} * kMaxPictureSide) > static_cast<double>(kMaxPictures)) return tooMany();
  bool fits = true;
  for (std::uint32_t sheet = 0; sheet < surface.sheets().size(); ++sheet)
    fits = addCharts(surface, sheet, atlas) && fits;
  if (!fits)
    return base::Error{base::ErrorCode::kInvalidInput,
                       std::to_string(texels) + " texels a triangle: so few triangles are wider than a picture of " +
                           std::to_string(kMaxPictureSide) + " texels; ask for more triangles or fewer texels"};
  if (atlas.style.tiles) {
    for (Chart& chart : atlas.charts) {
      chart.picture = static_cast<std::uint32_t>(atlas.pictures.size());
      atlas.pictures.push_back(atlas.extent(chart));
    }
  } else {
    placeInPictures(atlas);
  }
  if (atlas.pictures.size() > kMaxPictures) return tooMany();
  std::stable_sort(atlas.charts.begin(), atlas.charts.end(),
                   [](const Chart& a, const Chart& b) { return a.picture < b.picture; });
  std::uint64_t uv = 0;
  for (Chart& chart : atlas.charts) {
    chart.first_uv = uv;
    uv += std::uint64_t{chart.columns() + 1} * (chart.rows() + 1);
  }
  return atlas;
}

}  // namespace mesh::generate
