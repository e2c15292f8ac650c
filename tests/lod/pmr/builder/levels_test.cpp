// Decimation and umbrellas of shapes that are known.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numeric>

#include "lod/pmr/builder/decimate.h"
#include "lod/pmr/builder/tangent_polygon.h"
#include "lod/pmr/builder/umbrellas.h"
#include "lod/pmr/format.h"
#include "tests/support/point_levels.h"
#include "tests/support/shapes.h"
#include "tests/support/thinning.h"

namespace {

using namespace lod::pmr;
using namespace lod::pmr::builder;

struct Levels : support::PointLevels {
  explicit Levels(const std::vector<support::ShapeSample>& shape, float most = 1e9F)
      : PointLevels(placesOf(shape), most) {}
  static std::vector<glm::dvec3> placesOf(const std::vector<support::ShapeSample>& shape) {
    std::vector<glm::dvec3> places;
    for (const auto& sample : shape) places.push_back(sample.place);
    return places;
  }
  std::vector<Triangle> trianglesAt(std::uint32_t level) const { return umbrellasOf(at(level)); }
};

// The share of the samples whose ray from outside to inside along the normal meets no triangle. `reach`: half the
// length of the ray.
double uncovered(const std::vector<support::ShapeSample>& samples, const std::vector<glm::dvec3>& places,
                 const std::vector<Triangle>& triangles, double reach) {
  const double cell = reach;
  const auto keyOf = [cell](const glm::dvec3& p) {
    const glm::ivec3 q(glm::floor(p / cell));
    return std::tuple(q.x, q.y, q.z);
  };
  std::map<std::tuple<int, int, int>, std::vector<std::uint32_t>> grid;
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    glm::dvec3 low(1e300), high(-1e300);
    for (const std::uint32_t i : triangles[t].corners())
      low = glm::min(low, places[i]), high = glm::max(high, places[i]);
    const glm::ivec3 from(glm::floor(low / cell)), to(glm::floor(high / cell));
    for (int x = from.x; x <= to.x; ++x)
      for (int y = from.y; y <= to.y; ++y)
        for (int z = from.z; z <= to.z; ++z) grid[{x, y, z}].push_back(t);
  }
  const auto meets = [&](const support::ShapeSample& sample, std::uint32_t t) {
    const auto corners = triangles[t].corners();
    const glm::dvec3 &a = places[corners[0]], &b = places[corners[1]], &c = places[corners[2]];
    const glm::dvec3 cross = glm::cross(b - a, c - a);
    const double along = glm::dot(cross, sample.normal);
    if (along == 0.0) return false;
    const double s = glm::dot(cross, a - sample.place) / along;
    if (std::abs(s) > reach) return false;
    const glm::dvec3 p = sample.place + s * sample.normal;
    const double slack = -1e-9 * glm::dot(cross, cross);  // a ray through an edge counts
    return glm::dot(glm::cross(b - a, p - a), cross) >= slack && glm::dot(glm::cross(c - b, p - b), cross) >= slack &&
           glm::dot(glm::cross(a - c, p - c), cross) >= slack;
  };
  std::size_t missed = 0;
  for (const auto& sample : samples) {
    bool met = false;
    for (const double s : {-0.99, 0.0, 0.99}) {
      const auto found = grid.find(keyOf(sample.place + s * reach * sample.normal));
      if (found == grid.end() || met) continue;
      met = std::any_of(found->second.begin(), found->second.end(), [&](std::uint32_t t) { return meets(sample, t); });
    }
    missed += met ? 0 : 1;
  }
  return static_cast<double>(missed) / static_cast<double>(samples.size());
}

TEST(TangentPolygon, ofASquareGridIsASquare) {
  TangentPolygon polygon(glm::dvec3(0.0), glm::dvec3(0, 0, 1), 10.0);
  std::uint32_t number = 0;
  for (const double reach : {1.0, 2.0}) {
    for (const glm::dvec2 side : {glm::dvec2(1, 0), glm::dvec2(0, 1), glm::dvec2(-1, 0), glm::dvec2(0, -1)})
      polygon.cut(reach * glm::dvec3(side, 0.0), number++);
    for (const glm::dvec2 side : {glm::dvec2(1, 1), glm::dvec2(-1, 1), glm::dvec2(-1, -1), glm::dvec2(1, -1)})
      polygon.cut(reach * glm::dvec3(side, 0.0), number++);
  }
  EXPECT_EQ(polygon.corners(), 4U);
  EXPECT_NEAR(polygon.radius(), std::sqrt(0.5), 1e-12);
  for (std::uint32_t k = 0; k < 4; ++k) EXPECT_NE(polygon.edge(k), TangentPolygon::kNone);
}

TEST(TangentPolygon, keepsTheSquareWhereNothingCuts) {
  TangentPolygon polygon(glm::dvec3(0.0), glm::dvec3(0, 0, 1), 1.0);
  polygon.cut({1.0, 0.0, 0.0}, 7);
  polygon.cut({0.0, 0.0, 0.5}, 8);   // straight above: cuts nothing
  polygon.cut({0.0, 0.0, 0.0}, 9);   // at the centre
  polygon.cut({5.0, 0.0, 0.0}, 10);  // too far
  ASSERT_EQ(polygon.corners(), 4U);
  EXPECT_NEAR(polygon.radius(), std::sqrt(2.0), 1e-12);
  std::size_t open = 0, sevens = 0;
  for (std::uint32_t k = 0; k < 4; ++k) {
    open += polygon.edge(k) == TangentPolygon::kNone ? 1 : 0;
    sevens += polygon.edge(k) == 7 ? 1 : 0;
  }
  EXPECT_EQ(open, 3U);
  EXPECT_EQ(sevens, 1U);
}

TEST(Decimation, keepsWhatItsThresholdSays) {
  const Levels sphere(support::sphereSamples(1e5, 30000, 5));
  const double limit = std::accumulate(sphere.limits.begin(), sphere.limits.end(), 0.0) / 30000.0;
  ASSERT_LT(limit, 5e4);
  std::size_t finer = sphere.places.size();
  for (std::uint32_t level = 1; level < kLevels; ++level) {
    const auto left = sphere.at(level);
    ASSERT_LT(left.size(), finer);
    finer = left.size();
    // The limit is less than the sphere's radius, so that heights count as much as it: polygons are hexagons of the
    // radius ρ l, about, and none is smaller.
    const double radius = thresholdOf(level) * limit / 1e5;
    const double hexagons = 4.0 * std::numbers::pi / (1.5 * std::sqrt(3.0) * radius * radius);
    if (hexagons > 0.5 * static_cast<double>(sphere.places.size())) continue;
    if (left.size() < 100) continue;
    EXPECT_LT(static_cast<double>(left.size()), 1.8 * hexagons) << level;
    EXPECT_GT(static_cast<double>(left.size()), 0.3 * hexagons) << level;
  }
}

TEST(Decimation, leavesMorePointsWhereTheShapeIsThin) {
  // Points as far apart on a thin torus and on one four times as thick: the thin one has a quarter of the surface, and
  // keeps as many points of it where the thick one's height counts whole, more where the limit cuts that.
  const Levels thin(support::torusSamples(1e5, 5e3, 20000, 6));
  const Levels thick(support::torusSamples(1e5, 2e4, 80000, 6));
  for (const std::uint32_t level : {3U, 5U}) {
    EXPECT_GT(3 * thin.at(level).size(), thick.at(level).size()) << level;
    EXPECT_LT(thin.at(level).size(), 2 * thick.at(level).size()) << level;
  }
}

TEST(Decimation, keepsThinFeaturesWhichThinningWears) {
  // A ball, and a wire that is about as thin as points thinned to the same number are apart.
  support::Surface shape, wire;
  support::addRing(wire, {0, 0, 0}, 1.6e5, 4e3, 600, 24);
  support::addRing(shape, {0, 0, 0}, 1.6e5, 4e3, 600, 24);
  support::addRing(shape, {0, 0, 0}, 0.0, 8e4, 120, 60);
  const support::PointLevels levels(support::pointsOn(shape, 60000, 12));
  for (const std::uint32_t level : {4U, 8U}) {
    const auto left = levels.at(level);
    const auto distanceOf = [&](const std::vector<std::uint32_t>& points) {
      const support::Surface umbrellas = levels.surfaceOf(points);
      return sampledDistance(wire, support::NearestSurface(umbrellas), 5000).rms;
    };
    const double ours = distanceOf(left);
    EXPECT_LT(ours, 0.7 * distanceOf(support::uniformThinning(levels.places, left.size(), 13))) << level;
    EXPECT_LT(ours, 0.7 * distanceOf(support::randomThinning(levels.places.size(), left.size(), 14))) << level;
  }
}

// Sampled distances both ways, the larger of the two counts: a part that is missing shows in one, what bridges a gap in
// the other.
TEST(Decimation, isNearerToAMachinedPartThanThinning) {
  support::Surface part;
  support::addBox(part, {-1.5e5, -1e5, -1e5}, {1.5e5, 1e5, 1e4});
  support::addRing(part, {-7e4, 0, 1e4}, 5e4, 8e3, 300, 32);
  support::addRing(part, {8e4, 0, 2e4}, 0.0, 4e4, 120, 60);
  const support::PointLevels levels(support::pointsOn(part, 50000, 21));
  for (const std::uint32_t level : {2U, 4U, 8U}) {
    const auto left = levels.at(level);
    const auto distanceOf = [&](const std::vector<std::uint32_t>& points) {
      const support::Surface umbrellas = levels.surfaceOf(points);
      return std::max(sampledDistance(part, support::NearestSurface(umbrellas), 10000).rms,
                      sampledDistance(umbrellas, support::NearestSurface(part), 10000).rms);
    };
    const double ours = distanceOf(left);
    EXPECT_LT(ours, distanceOf(support::uniformThinning(levels.places, left.size(), 22))) << level;
    EXPECT_LT(ours, distanceOf(support::randomThinning(levels.places.size(), left.size(), 23))) << level;
  }
}

TEST(Decimation, staysWithinItsThresholdOfTheShape) {
  // The umbrellas of a ball of radius R at threshold ρ are chords of polygons of radius ρ √(R l): their middle is
  // ρ² l / 2 deep, however large the ball. Level 0 has a depth of its own, that of its points' distances.
  for (const std::size_t points : {30000, 2000}) {
    support::Surface ball;
    support::addRing(ball, {0, 0, 0}, 0.0, 1e5, 240, 120);
    const Levels levels(support::sphereSamples(1e5, points, 15));
    const double limit = std::accumulate(levels.limits.begin(), levels.limits.end(), 0.0) / static_cast<double>(points);
    for (const std::uint32_t level : {2U, 5U, 8U}) {
      const double bound = 1.5 * thresholdOf(level) * thresholdOf(level) * limit;
      const support::Surface umbrellas = levels.surfaceOf(levels.at(level));
      EXPECT_LT(sampledDistance(ball, support::NearestSurface(umbrellas), 5000).p999, bound) << points << ' ' << level;
      EXPECT_LT(sampledDistance(umbrellas, support::NearestSurface(ball), 5000).p999, bound) << points << ' ' << level;
    }
  }
}

TEST(Decimation, keepsTheRimOfAnOpenSurface) {
  std::vector<support::ShapeSample> plane;
  for (int x = 0; x < 60; ++x)
    for (int y = 0; y < 60; ++y) plane.push_back({{1000.0 * x, 1000.0 * y, 0.0}, {0, 0, 1}, 0.0});
  const Levels levels(plane, 6e3F);
  std::size_t corners = 0;
  for (const std::uint32_t i : levels.at(kCoarsest)) {
    const glm::dvec3 p = glm::round(levels.places[i]);
    corners += (p.x == 0.0 || p.x == 59000.0) && (p.y == 0.0 || p.y == 59000.0) ? 1 : 0;
  }
  EXPECT_EQ(corners, 4U);
  EXPECT_LT(levels.at(kCoarsest).size(), 600U);
}

TEST(Umbrellas, coverClosedSurfacesAtEachLevel) {
  const auto shapes = {support::sphereSamples(1e5, 20000, 7), support::torusSamples(1e5, 4e4, 30000, 8)};
  for (const auto& shape : shapes) {
    const Levels levels(shape);
    const auto probes =
        shape.front().height == 1e5 ? support::sphereSamples(1e5, 20000, 9) : support::torusSamples(1e5, 4e4, 20000, 9);
    for (const std::uint32_t level : {0U, 1U, 2U, 5U}) {
      const auto triangles = levels.trianglesAt(level);
      // At the finest thresholds less than 0.01 % of the area; sparse levels, which are seen from afar, may have more.
      EXPECT_LT(uncovered(probes, levels.places, triangles, 2e4), level == 5 ? 1e-3 : 1e-4) << level;
      // Twice as many as points: a closed surface (Euler), with few that overlap.
      if (level == 5) continue;
      EXPECT_LT(static_cast<double>(triangles.size()), 2.1 * static_cast<double>(levels.at(level).size())) << level;
    }
  }
}

TEST(Umbrellas, ofARegularGridCoverIt) {
  std::vector<support::ShapeSample> plane, probes;
  std::mt19937 random(10);
  std::uniform_real_distribution<double> at(0.0, 29000.0);
  for (int x = 0; x < 30; ++x)
    for (int y = 0; y < 30; ++y) plane.push_back({{1000.0 * x, 1000.0 * y, 0.0}, {0, 0, 1}, 0.0});
  for (int i = 0; i < 5000; ++i) probes.push_back({{at(random), at(random), 0.0}, {0, 0, 1}, 0.0});
  const Levels levels(plane, 6e3F);
  EXPECT_EQ(uncovered(probes, levels.places, levels.trianglesAt(0), 2e3), 0.0);
  EXPECT_EQ(uncovered(probes, levels.places, levels.trianglesAt(3), 2e3), 0.0);
}

TEST(Umbrellas, leaveWideGapsOpen) {
  // Two squares of a plane with a gap of twenty spacings between them.
  std::vector<support::ShapeSample> halves;
  for (int x = 0; x < 60; ++x)
    for (int y = 0; y < 30; ++y)
      halves.push_back({{1000.0 * x + (x < 30 ? 0.0 : 20000.0), 1000.0 * y, 0.0}, {0, 0, 1}, 0.0});
  const Levels levels(halves, 6e3F);
  for (const Triangle& triangle : levels.trianglesAt(0)) {
    double low = 1e300, high = -1e300;
    for (const std::uint32_t i : triangle.corners()) {
      low = std::min(low, levels.places[i].x);
      high = std::max(high, levels.places[i].x);
    }
    EXPECT_LT(high - low, 10000.0);
  }
}

TEST(Umbrellas, doNotDependOnWhoElseIsThere) {
  // The umbrellas of points in the middle of a part are those of the whole.
  const Levels all(support::torusSamples(1e5, 4e4, 20000, 11));
  const auto triangles = all.trianglesAt(0);
  std::vector<std::uint32_t> near;
  for (std::uint32_t i = 0; i < all.places.size(); ++i)
    if (all.places[i].x > 0.0) near.push_back(i);
  std::vector<glm::dvec3> places;
  for (const std::uint32_t i : near) places.push_back(all.places[i]);
  Umbrellas umbrellas(places, near);
  std::vector<Triangle> found;
  Umbrella umbrella;
  for (std::uint32_t k = 0; k < near.size(); ++k) {
    if (places[k].x <= 3e4) continue;
    umbrellas.find(k, glm::vec3(all.normals[near[k]]), 0.0, umbrella);
    umbrella.appendTriangles(near[k], found);
  }
  ASSERT_GT(found.size(), 1000U);
  for (const Triangle& triangle : found) EXPECT_TRUE(std::binary_search(triangles.begin(), triangles.end(), triangle));
}

}  // namespace
