// The estimate of how far a place is from one of its appearance, against the nearest place of equal appearance found by
// looking everywhere.
#include "lod/hlod/builder/appearance.h"

#include <gtest/gtest.h>

#include <random>

#include "base/geometry.h"
#include "tests/lod/hlod/builder/node_meshes.h"

namespace {

using namespace lod::hlod::builder;

float weightedError(const support::SurfacePlace& place, const support::SurfacePlace& a, const support::SurfacePlace& b,
                    const support::SurfacePlace& c, float least_turn, float least_color,
                    const AppearanceOptions& options) {
  constexpr int kSteps = 300;
  float best = std::numeric_limits<float>::infinity();
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; i + j <= kSteps; ++j) {
      const float u = static_cast<float>(i) / kSteps, v = static_cast<float>(j) / kSteps, w = 1.0F - u - v;
      const glm::vec3 normal = glm::normalize(w * a.normal + u * b.normal + v * c.normal);
      if (options.normals && angleBetween(normal, place.normal) > least_turn) continue;
      const glm::vec3 color = w * a.color + u * b.color + v * c.color;
      if (options.colors && glm::length(color - place.color) > least_color) continue;
      best = std::min(best, glm::distance(place.position, w * a.position + u * b.position + v * c.position));
    }
  return best;
}

support::SurfacePlace onSphere(float radius, float x, float y) {
  const glm::vec3 n = glm::normalize(glm::vec3(x, y, std::sqrt(std::max(radius * radius - x * x - y * y, 0.0F))));
  return {radius * n, n, glm::vec3(0.0F)};
}

// Triangles of all shapes down to slivers without area, and places all around them, against a search in double.
TEST(Appearance, theClosestPlaceIsOnTheTriangleAndNoneIsCloser) {
  std::mt19937 random(7);
  for (int trial = 0; trial < 20000; ++trial) {
    const int y = trial % 4 == 0 ? 4000 : trial % 4 == 1 ? 3 : 0, z = trial % 4 == 3 ? 0 : 3;
    const auto upTo = [&](int most) { return std::uniform_int_distribution<int>(0, most)(random); };
    const auto corner = [&] { return glm::vec3(upTo(4000), upTo(y), upTo(z)); };
    const glm::vec3 a = corner(), b = corner(), c = corner();
    if (a == b || b == c || c == a) continue;
    const glm::vec3 p(upTo(4000), upTo(1000), upTo(4000) - 2000);
    const FourTriangles triangles(support::fourOf(a, b, c, a), support::fourOf(b, c, a, c),
                                  support::fourOf(c, a, b, b));
    const FourTriangles::Closest closest = triangles.closest(fourOf(p));
    const glm::dvec3 weight =
        base::closestWeightsOnTriangle(glm::dvec3(p), glm::dvec3(a), glm::dvec3(b), glm::dvec3(c));
    const double least =
        glm::distance(glm::dvec3(p), weight.x * glm::dvec3(a) + weight.y * glm::dvec3(b) + weight.z * glm::dvec3(c));
    for (std::size_t lane = 0; lane < 4; ++lane) {
      const float b_weight = closest.b_weight[lane], c_weight = closest.c_weight[lane];
      EXPECT_GE(std::min({b_weight, c_weight, 1.0F - b_weight - c_weight}), -1e-6F) << "trial " << trial;
      EXPECT_NEAR(std::sqrt(static_cast<double>(closest.distance2[lane])), least, 0.05) << "trial " << trial;
    }
  }
}

// A triangle with corners on a sphere, and places of the sphere above it: the normals of both surfaces are equal a
// little away from the closest place.
TEST(Appearance, theDistanceToAnEqualNormalIsBoundedOnCurvedPatches) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  AppearanceOptions options;
  options.colors = false;
  options.negligible_turn = 0.0F;
  std::size_t bounded = 0, checked = 0;
  for (int trial = 0; trial < 60; ++trial) {
    // One curvature, as on a sphere, and two, as on the triangle of a cylinder's normals.
    const float radius = 100.0F, size = 5.0F + 20.0F * unit(random);
    support::SurfacePlace a = onSphere(radius, 0.0F, 0.0F), b = onSphere(radius, size, size * 0.2F * unit(random)),
                          c = onSphere(radius, size * unit(random), size);
    // Bent normals move the place of an equal normal along the triangle.
    const glm::vec3 bend(0.15F * (unit(random) - 0.5F), 0.15F * (unit(random) - 0.5F), 0.0F);
    float u = unit(random), v = unit(random);
    if (u + v > 1.0F) u = 1.0F - u, v = 1.0F - v;
    const float w = 1.0F - u - v;
    support::SurfacePlace place = {w * a.position + u * b.position + v * c.position, {}, {}};
    place.position.z += 0.3F * unit(random);
    place.normal = glm::normalize(w * a.normal + u * b.normal + v * c.normal + bend);
    const float found = weightedError(place, a, b, c, 0.002F, 0.0F, options);
    if (!std::isfinite(found)) continue;  // no place of the triangle has this normal
    const Four stated2 = support::errors2(place, a, b, c, options);
    const float stated = std::sqrt(stated2[0]);
    for (std::size_t lane = 1; lane < 4; ++lane) EXPECT_NEAR(std::sqrt(stated2[lane]), stated, 1e-3F + 1e-3F * stated);
    ++checked;
    // The search goes by steps, and takes normals 0.002 radians apart for equal.
    const float step = size / 300.0F + 0.002F * radius;
    bounded += found <= stated + step ? 1 : 0;
    if (found > 4.0F * step) {
      EXPECT_LE(stated, 3.0F * (found + step)) << "trial " << trial;
    }
  }
  EXPECT_GT(checked, 25U);
  EXPECT_EQ(bounded, checked);
}

TEST(Appearance, theDistanceToAnEqualColorIsBounded) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  AppearanceOptions options;
  options.normals = false;
  options.negligible_color = 0.0F;
  std::size_t checked = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const glm::vec3 slope(10.0F * unit(random), 10.0F * unit(random), 10.0F * unit(random));
    const auto at = [&](float x, float y) {
      return support::SurfacePlace{{x, y, 0.0F}, {0.0F, 0.0F, 1.0F}, glm::vec3(50.0F) + slope * (x + 0.5F * y)};
    };
    const support::SurfacePlace a = at(0, 0), b = at(10, 0), c = at(0, 10);
    // Places from which the way along the colours' slope does not leave the triangle.
    const float x = 2.5F + unit(random), y = 2.5F + unit(random);
    support::SurfacePlace place = at(x, y);
    place.color += slope * (3.0F * unit(random) - 1.5F);
    const float tolerance = 0.05F * glm::length(slope);
    const float found = weightedError(place, a, b, c, 0.0F, tolerance, options);
    if (!std::isfinite(found)) continue;
    const float stated = std::sqrt(support::errors2(place, a, b, c, options)[0]);
    ++checked;
    EXPECT_LE(found, stated + 0.1F) << "trial " << trial;
    if (found > 0.5F) {
      EXPECT_LE(stated, 3.0F * (found + 0.1F)) << "trial " << trial;
    }
  }
  EXPECT_GT(checked, 25U);
}

TEST(Appearance, anAttributeThatTheTriangleLacksIsInfinitelyFar) {
  AppearanceOptions options;
  const support::SurfacePlace a{{0, 0, 0}, {0, 0, 1}, {10, 10, 10}}, b{{9, 0, 0}, {0, 0, 1}, {10, 10, 10}},
      c{{0, 9, 0}, {0, 0, 1}, {10, 10, 10}};
  const auto error2 = [&](const support::SurfacePlace& at) { return support::errors2(at, a, b, c, options)[0]; };
  support::SurfacePlace place{{1, 1, 2}, {0, 0, 1}, {10, 10, 10}};
  EXPECT_FLOAT_EQ(error2(place), 4.0F);
  place.color.r = 10.0F + 0.9F * options.negligible_color;
  EXPECT_FLOAT_EQ(error2(place), 4.0F);
  place.color.r = 60.0F;
  EXPECT_TRUE(std::isinf(error2(place)));
  place.color.r = 10.0F;
  place.normal = {1, 0, 0};
  EXPECT_TRUE(std::isinf(error2(place)));
}

}  // namespace
