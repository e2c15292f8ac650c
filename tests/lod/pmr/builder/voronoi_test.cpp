// Normals and heights against those of shapes whose medial axis is known.
#include "lod/pmr/builder/voronoi.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/shapes.h"

namespace {

using namespace lod::pmr::builder;

std::vector<glm::dvec3> placesOf(const std::vector<support::ShapeSample>& samples) {
  std::vector<glm::dvec3> places;
  for (const auto& sample : samples) places.push_back(sample.place);
  return places;
}

struct Deviation {
  double median_degrees = 0.0, p95_degrees = 0.0;
  double median_height = 0.0;  // ratio to the true height
  double p5_height = 0.0, p95_height = 0.0;
};

Deviation deviationOf(const std::vector<support::ShapeSample>& samples) {
  const auto places = placesOf(samples);
  const auto cells = voronoiCells(places);
  std::vector<double> degrees, heights;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double cosine = std::min(1.0, std::abs(glm::dot(cells[i].normal, samples[i].normal)));
    degrees.push_back(std::acos(cosine) * 180.0 / std::numbers::pi);
    heights.push_back(cells[i].height / samples[i].height);
  }
  std::sort(degrees.begin(), degrees.end());
  std::sort(heights.begin(), heights.end());
  const std::size_t n = degrees.size();
  return {degrees[n / 2], degrees[n * 95 / 100], heights[n / 2], heights[n / 20], heights[n * 95 / 100]};
}

TEST(Voronoi, normalsAndHeightsOfASphere) {
  const Deviation found = deviationOf(support::sphereSamples(1e5, 20000, 1));
  EXPECT_LT(found.median_degrees, 3.0);
  EXPECT_NEAR(found.median_height, 1.0, 0.01);
  EXPECT_GT(found.p5_height, 0.95);
  EXPECT_LT(found.p95_height, 1.01);
}

TEST(Voronoi, normalsAndHeightsOfATorus) {
  const Deviation found = deviationOf(support::torusSamples(1e5, 4e4, 40000, 2));
  EXPECT_LT(found.median_degrees, 3.0);
  EXPECT_LT(found.p95_degrees, 3.0);
  EXPECT_NEAR(found.median_height, 1.0, 0.01);
  EXPECT_GT(found.p5_height, 0.95);
  EXPECT_LT(found.p95_height, 1.02);
}

TEST(Voronoi, normalsAndHeightsOfABox) {
  // At edges there is neither a normal nor a height: only samples away from them are asked.
  const glm::dvec3 edges(1e5, 8e4, 6e4);
  const auto samples = support::boxSamples(edges, 40000, 3);
  const auto places = placesOf(samples);
  const auto cells = voronoiCells(places);
  std::vector<double> degrees, heights;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (samples[i].height < 5e3) continue;
    degrees.push_back(std::acos(std::min(1.0, std::abs(glm::dot(cells[i].normal, samples[i].normal)))) * 180.0 /
                      std::numbers::pi);
    heights.push_back(cells[i].height / samples[i].height);
  }
  std::sort(degrees.begin(), degrees.end());
  std::sort(heights.begin(), heights.end());
  EXPECT_LT(degrees[degrees.size() / 2], 3.0);
  EXPECT_NEAR(heights[heights.size() / 2], 1.0, 0.05);
}

TEST(Voronoi, theThinnerSideCounts) {
  // Two planes close together: the axis between them is near, those outside are far.
  std::vector<glm::dvec3> places;
  std::mt19937 random(4);
  std::uniform_real_distribution<double> at(0.0, 1e5);
  for (int i = 0; i < 8000; ++i) places.emplace_back(at(random), at(random), i % 2 == 0 ? 0.0 : 1e4);
  const auto cells = voronoiCells(places);
  std::vector<double> heights;
  for (const auto& cell : cells) heights.push_back(cell.height);
  std::sort(heights.begin(), heights.end());
  EXPECT_NEAR(heights[heights.size() / 2], 5e3, 1e3);
}

TEST(Voronoi, flatAndFewPointsHaveCells) {
  EXPECT_TRUE(voronoiCells({}).empty());
  for (const std::size_t count : {1U, 2U, 3U, 4U, 5U}) {
    std::vector<glm::dvec3> line;
    for (std::size_t i = 0; i < count; ++i) line.emplace_back(10.0 * static_cast<double>(i), 5.0, 5.0);
    for (const auto& cell : voronoiCells(line)) {
      EXPECT_NEAR(glm::length(cell.normal), 1.0, 1e-9);
      EXPECT_GT(cell.height, 0.0);
    }
  }
  // A regular grid: all coplanar, all of a square cocircular.
  std::vector<glm::dvec3> grid;
  for (int x = 0; x < 40; ++x)
    for (int y = 0; y < 40; ++y) grid.emplace_back(100.0 * x, 100.0 * y, 7.0);
  const auto cells = voronoiCells(grid);
  for (std::size_t i = 0; i < grid.size(); ++i) {
    if (glm::all(glm::greaterThan(grid[i], glm::dvec3(0.0))) && grid[i].x < 3900.0 && grid[i].y < 3900.0) {
      EXPECT_GT(std::abs(cells[i].normal.z), 0.99);
    }
  }
}

}  // namespace
