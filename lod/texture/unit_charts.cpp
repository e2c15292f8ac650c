#include "lod/texture/unit_charts.h"

#include <algorithm>
#include <tuple>

#include "lod/texture/coverage.h"
#include "lod/texture/wrapped.h"

namespace lod::texture {
namespace {

bool isLine(const StepTriangle& triangle) {
  const glm::i64vec2 u(triangle.corners[1] - triangle.corners[0]), v(triangle.corners[2] - triangle.corners[0]);
  return u.x * v.y == u.y * v.x;
}

// Longer charts are not cut out in units, since no page is as large; texels.
constexpr int kLongest = 4096;

// The cells of an axis that a unit at `cell` of the repeated picture shows, of a chart that ends before `end`. The last
// unit of a picture that does not fill it holds nothing of the next repetition unless the chart goes on there.
std::array<int, 2> cellsOf(int cell, int end, int unit, int picture, int cells) {
  const bool crosses = end > picture && (cell + 1) * unit > picture;
  if (cell >= 0 && cell < cells && !crosses) return {cell, cell};
  return {wrapped(cell * unit, picture) / unit, wrapped(cell * unit + unit - 1, picture) / unit};
}

}  // namespace

UnitCharts::UnitCharts(const glm::ivec2& picture, const glm::ivec2& unit)
    : picture_(picture), unit_(unit), size_((picture + unit - 1) / unit) {
  cells_.resize(static_cast<std::size_t>(size_.x) * static_cast<std::size_t>(size_.y), kNone);
}

std::uint32_t UnitCharts::add(std::span<const Chart> charts) {
  const std::lock_guard lock(mutex_);
  const auto first = static_cast<std::uint32_t>(parents_.size());
  for (const Chart& chart : charts) {
    const auto number = static_cast<std::uint32_t>(parents_.size());
    parents_.push_back(number);
    addEdges(chart, number);
    addCells(chart, number);
  }
  return first;
}

void UnitCharts::addEdges(const Chart& chart, std::uint32_t number) {
  const glm::ivec2 period = picture_ * kCornerSteps;
  std::vector<Edge> edges;
  edges.reserve(3 * chart.triangles.size());
  for (const StepTriangle& triangle : chart.triangles)
    for (int i = 0; i < 3; ++i) {
      glm::ivec2 a = triangle.corners[i], b = triangle.corners[(i + 1) % 3];
      if (std::tie(b.x, b.y) < std::tie(a.x, a.y)) std::swap(a, b);
      const glm::ivec2 least = glm::min(a, b);
      const glm::ivec2 shift = least - glm::ivec2(wrapped(least.x, period.x), wrapped(least.y, period.y));
      a -= shift, b -= shift;
      edges.push_back({{a.x, a.y, b.x, b.y}, number});
    }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) { return a.ends < b.ends; });
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].ends == edges[begin].ends) ++end;
    if (end - begin == 1) edges_.push_back(edges[begin]);
  }
}

void UnitCharts::addCells(const Chart& chart, std::uint32_t number) {
  if (glm::any(glm::greaterThan(chart.size(), glm::max(picture_, kLongest)))) {
    std::fill(cells_.begin(), cells_.end(), kSeveral);
    return;
  }
  const glm::dvec2 unit(unit_);
  const glm::ivec2 first = glm::ivec2(glm::floor(glm::dvec2(chart.min) / unit)) - 1;
  const glm::ivec2 size = glm::ivec2(glm::ceil(glm::dvec2(chart.max) / unit)) + 1 - first;
  std::vector<std::uint8_t> shown(static_cast<std::size_t>(size.x) * static_cast<std::size_t>(size.y));
  const MaskView mask{shown.data(), size.x, size.x, size.y};
  for (const StepTriangle& triangle : chart.triangles) {
    if (isLine(triangle)) continue;  // it shows nothing
    std::array<glm::dvec2, 3> corners;
    for (int i = 0; i < 3; ++i)
      corners[i] = glm::dvec2(triangle.corners[i]) / (double{kCornerSteps} * unit) - glm::dvec2(first);
    coverTriangle(corners, 0.5, mask);
  }
  for (int y = 0; y < size.y; ++y)
    for (int x = 0; x < size.x; ++x)
      if (mask.row(y)[x] != 0) addCell(first + glm::ivec2(x, y), chart.max, number);
}

void UnitCharts::addCell(const glm::ivec2& cell, const glm::ivec2& end, std::uint32_t number) {
  const auto xs = cellsOf(cell.x, end.x, unit_.x, picture_.x, size_.x);
  const auto ys = cellsOf(cell.y, end.y, unit_.y, picture_.y, size_.y);
  for (const int y : ys)
    for (const int x : xs) {
      std::uint32_t& known = cells_[index({x, y})];
      if (known == kNone)
        known = number;
      else if (known != number && known != kSeveral)
        also_.emplace_back(index({x, y}), number);
    }
}

void UnitCharts::join() {
  std::sort(edges_.begin(), edges_.end(), [](const Edge& a, const Edge& b) { return a.ends < b.ends; });
  for (std::size_t i = 1; i < edges_.size(); ++i) {
    if (edges_[i].ends != edges_[i - 1].ends) continue;
    const std::uint32_t a = setOf(parents_, edges_[i - 1].chart), b = setOf(parents_, edges_[i].chart);
    parents_[std::max(a, b)] = std::min(a, b);
  }
  edges_ = {};
  for (std::uint32_t chart = 0; chart < parents_.size(); ++chart) parents_[chart] = setOf(parents_, chart);
  for (std::uint32_t& cell : cells_)
    if (cell != kNone && cell != kSeveral) cell = parents_[cell];
  for (const auto& [cell, chart] : also_)
    if (cells_[cell] != parents_[chart]) cells_[cell] = kSeveral;
  also_ = {};
}

}  // namespace lod::texture
