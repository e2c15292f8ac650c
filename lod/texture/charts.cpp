#include "lod/texture/charts.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace lod::texture {
namespace {

constexpr float kMaxTexel = 1e6F;  // a picture has at most 16384 a side, so this is 61 repetitions of the largest

bool isUsable(const PictureTriangle& triangle) {
  return std::all_of(triangle.corners.begin(), triangle.corners.end(), [](const glm::vec2& c) {
    return std::abs(c.x) <= kMaxTexel && std::abs(c.y) <= kMaxTexel;  // false for NaN
  });
}

// Rounds down, also below zero.
glm::ivec2 floorDivided(const glm::ivec2& a, const glm::ivec2& b) {
  const auto divided = [](int n, int d) { return n / d - (n % d < 0 ? 1 : 0); };
  return {divided(a.x, b.x), divided(a.y, b.y)};
}

// Both ends of an edge, the lesser first.
struct Edge {
  std::array<int, 4> ends{};
  std::uint32_t triangle = 0;
};

std::vector<Edge> sortedEdges(std::span<const StepTriangle> triangles) {
  std::vector<Edge> edges;
  edges.reserve(3 * triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    for (int i = 0; i < 3; ++i) {
      glm::ivec2 a = triangles[t].corners[i];
      glm::ivec2 b = triangles[t].corners[(i + 1) % 3];
      if (std::tie(b.x, b.y) < std::tie(a.x, a.y)) std::swap(a, b);
      edges.push_back({{a.x, a.y, b.x, b.y}, t});
    }
  }
  std::sort(edges.begin(), edges.end(),
            [](const Edge& a, const Edge& b) { return std::tie(a.ends, a.triangle) < std::tie(b.ends, b.triangle); });
  return edges;
}

void findRectangle(Chart& chart) {
  glm::ivec2 least = chart.triangles.front().corners[0];
  glm::ivec2 greatest = least;
  for (const StepTriangle& triangle : chart.triangles) {
    for (const glm::ivec2& corner : triangle.corners) {
      least = glm::min(least, corner);
      greatest = glm::max(greatest, corner);
    }
  }
  const glm::ivec2 steps(kCornerSteps);
  chart.min = floorDivided(least, steps);
  chart.max = glm::max(-floorDivided(-greatest, steps), chart.min + 1);
}

}  // namespace

std::vector<StepTriangle> roundTriangles(std::span<const PictureTriangle> triangles) {
  std::vector<StepTriangle> rounded;
  rounded.reserve(triangles.size());
  for (const PictureTriangle& triangle : triangles) {
    if (!isUsable(triangle)) continue;
    StepTriangle& added = rounded.emplace_back();
    added.triangle = triangle.triangle;
    for (int i = 0; i < 3; ++i)
      added.corners[i] = glm::ivec2(glm::floor(glm::dvec2(triangle.corners[i]) * double{kCornerSteps} + 0.5));
  }
  return rounded;
}

std::uint32_t setOf(std::vector<std::uint32_t>& parents, std::uint32_t item) {
  while (parents[item] != item) item = parents[item] = parents[parents[item]];
  return item;
}

std::vector<Chart> findCharts(std::span<const StepTriangle> triangles) {
  std::vector<std::uint32_t> parents(triangles.size());
  std::iota(parents.begin(), parents.end(), 0U);
  const std::vector<Edge> edges = sortedEdges(triangles);
  for (std::size_t i = 1; i < edges.size(); ++i) {
    if (edges[i].ends != edges[i - 1].ends) continue;
    const std::uint32_t a = setOf(parents, edges[i - 1].triangle);
    const std::uint32_t b = setOf(parents, edges[i].triangle);
    parents[std::max(a, b)] = std::min(a, b);
  }

  // A set's name is its first triangle, so its chart is there when the others come.
  std::vector<Chart> charts;
  std::vector<std::uint32_t> chart_of(triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const std::uint32_t first = setOf(parents, t);
    if (first == t) {
      chart_of[t] = static_cast<std::uint32_t>(charts.size());
      charts.emplace_back();
    }
    charts[chart_of[first]].triangles.push_back(triangles[t]);
  }
  for (Chart& chart : charts) findRectangle(chart);
  return charts;
}

std::vector<Chart> foldRepetitions(std::vector<Chart> charts, const glm::ivec2& picture) {
  const auto repeats = [&](const Chart& chart) { return glm::any(glm::greaterThan(chart.size(), picture)); };
  const auto folded = std::stable_partition(charts.begin(), charts.end(), [&](const Chart& c) { return !repeats(c); });
  if (folded == charts.end()) return charts;

  const glm::ivec2 period = picture * kCornerSteps;
  std::vector<StepTriangle> moved;
  for (auto chart = folded; chart != charts.end(); ++chart) {
    for (StepTriangle triangle : chart->triangles) {
      const auto& [a, b, c] = triangle.corners;
      const glm::ivec2 twice_middle = glm::min(glm::min(a, b), c) + glm::max(glm::max(a, b), c);
      const glm::ivec2 shift = floorDivided(twice_middle, 2 * period) * period;
      for (glm::ivec2& corner : triangle.corners) corner -= shift;
      moved.push_back(triangle);
    }
  }
  charts.erase(folded, charts.end());
  for (Chart& chart : findCharts(moved)) charts.push_back(std::move(chart));
  return charts;
}

}  // namespace lod::texture
