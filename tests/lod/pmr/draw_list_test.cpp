#include "lod/pmr/draw_list.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

namespace lod::pmr {
namespace {

struct Model {
  std::vector<glm::vec3> positions;
  std::vector<bool> is_own;
  std::vector<std::uint16_t> corners;
};

Model randomModel(unsigned seed, std::size_t vertices, std::size_t triangles) {
  std::mt19937 random(seed);
  const auto number = [&] { return static_cast<float>(random() % 1000) / 100.0F; };
  Model model;
  for (std::size_t v = 0; v < vertices; ++v) {
    model.positions.emplace_back(number(), number(), number());
    model.is_own.push_back(random() % 4 != 0);
  }
  while (model.corners.size() < 3 * triangles) {
    const auto corner = [&] { return static_cast<std::uint16_t>(random() % vertices); };
    const std::uint16_t a = corner(), b = corner(), c = corner();
    if (a != b && b != c && c != a) model.corners.insert(model.corners.end(), {a, b, c});
  }
  return model;
}

/// The paper's rule, point by point.
float umbrellaRadius(const Model& model, std::size_t point) {
  float radius = 0.0F;
  for (std::size_t i = 0; i < model.corners.size(); i += 3) {
    const auto triangle = std::span(model.corners).subspan(i, 3);
    if (std::find(triangle.begin(), triangle.end(), point) == triangle.end()) continue;
    for (const std::uint16_t other : triangle)
      radius = std::max(radius, glm::length(model.positions[point] - model.positions[other]));
  }
  return radius;
}

using Triangle = std::array<std::uint16_t, 3>;

std::multiset<Triangle> firstTriangles(const std::vector<std::uint16_t>& corners, std::size_t count) {
  std::multiset<Triangle> triangles;
  for (std::size_t t = 0; t < count; ++t) triangles.insert({corners[3 * t], corners[3 * t + 1], corners[3 * t + 2]});
  return triangles;
}

TEST(DrawListTest, atEachPixelPointsAndTrianglesAreThoseOfThePaper) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Model model = randomModel(seed, 40, 5 * seed);
    const DrawList list = makeDrawList(model.positions, model.is_own, model.corners);
    EXPECT_TRUE(std::is_sorted(list.point_radii.rbegin(), list.point_radii.rend()));
    EXPECT_EQ(list.corners, model.corners);
    const SortedTriangles sorted = sortedTriangles(list, model.positions.size());
    EXPECT_TRUE(std::is_sorted(sorted.reaches.rbegin(), sorted.reaches.rend()));
    for (const float pixel : {1e-6F, 1.0F, 7.0F, 13.0F, 20.0F, 25.0F, 1000.0F}) {
      std::set<std::uint16_t> points;
      std::multiset<Triangle> triangles;
      for (std::size_t p = 0; p < model.positions.size(); ++p)
        if (model.is_own[p] && 2.0F * umbrellaRadius(model, p) < pixel) points.insert(static_cast<std::uint16_t>(p));
      for (std::size_t i = 0; i < model.corners.size(); i += 3) {
        bool drawn = false;
        for (std::size_t k = i; k < i + 3; ++k)
          drawn |= model.is_own[model.corners[k]] && points.count(model.corners[k]) == 0;
        if (drawn) triangles.insert({model.corners[i], model.corners[i + 1], model.corners[i + 2]});
      }
      const DrawnPart drawn_points = list.pointsAt(pixel);
      EXPECT_EQ(
          std::set<std::uint16_t>(list.points.begin() + drawn_points.first, list.points.begin() + drawn_points.end),
          points);
      EXPECT_EQ(drawn_points.count(), points.size());
      EXPECT_EQ(firstTriangles(sorted.corners, countUmbrellas(sorted.reaches, pixel)), triangles);
      EXPECT_EQ(list.drawsAllTriangles(pixel), 3 * triangles.size() == model.corners.size());
    }
  }
}

TEST(DrawListTest, aPointWithoutTrianglesIsAPointAtAnyPixel) {
  const DrawList list = makeDrawList(std::vector<glm::vec3>(3), {true, true, false}, {});
  EXPECT_EQ(list.points.size(), 2U);
  EXPECT_EQ(list.pointsAt(1e-20F).count(), 2U);
  EXPECT_TRUE(sortedTriangles(list, 3).corners.empty());
}

TEST(DrawListTest, nothingMakesAnEmptyList) {
  const DrawList list = makeDrawList({}, {}, {});
  EXPECT_EQ(list.pointsAt(1.0F).count(), 0U);
  EXPECT_TRUE(sortedTriangles(list, 0).corners.empty());
}

}  // namespace
}  // namespace lod::pmr
