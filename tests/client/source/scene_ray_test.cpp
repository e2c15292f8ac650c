#include "client/source/scene_ray.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace client {
namespace {

/// A ray along −z from (0, 0, 5).
const SceneRay kDown{{0.0, 0.0, 5.0}, {0.0, 0.0, -1.0}};

TEST(SceneRay, meetsATriangleFromBothSidesAndNotBesideIt) {
  const glm::dvec3 a(-1.0, -1.0, 2.0), b(1.0, -1.0, 2.0), c(0.0, 1.0, 2.0);
  EXPECT_DOUBLE_EQ(distanceToTriangle(kDown, a, b, c), 3.0);
  EXPECT_DOUBLE_EQ(distanceToTriangle(kDown, a, c, b), 3.0);
  const glm::dvec3 aside(3.0, 0.0, 0.0), behind(0.0, 0.0, 4.0);
  EXPECT_TRUE(std::isinf(distanceToTriangle(kDown, a + aside, b + aside, c + aside)));
  EXPECT_TRUE(std::isinf(distanceToTriangle(kDown, a + behind, b + behind, c + behind)));
  EXPECT_TRUE(std::isinf(distanceToTriangle(kDown, a, a, b))) << "an edge alone";
}

TEST(SceneRay, passesPointsAndLinesByTheirRadius) {
  EXPECT_DOUBLE_EQ(distanceToPoint(kDown, {0.3, 0.4, 1.0}, 0.51), 4.0);
  EXPECT_TRUE(std::isinf(distanceToPoint(kDown, {0.3, 0.4, 1.0}, 0.49)));
  EXPECT_TRUE(std::isinf(distanceToPoint(kDown, {0.0, 0.0, 6.0}, 0.5))) << "behind the origin";

  const glm::dvec3 a(-1.0, 0.2, 0.0), b(3.0, 0.2, 2.0);
  EXPECT_DOUBLE_EQ(distanceToLine(kDown, a, b, 0.21), 4.5);
  EXPECT_DOUBLE_EQ(distanceToLine(kDown, b, a, 0.21), 4.5);
  EXPECT_TRUE(std::isinf(distanceToLine(kDown, a, b, 0.19)));
  EXPECT_TRUE(std::isinf(distanceToLine(kDown, a + glm::dvec3(2.0, 0.0, 0.0), b, 0.21))) << "beyond its end";
  EXPECT_DOUBLE_EQ(distanceToLine(kDown, {0.1, 0.0, 1.0}, {0.1, 0.0, 2.0}, 0.2), 4.0) << "along the ray, one end";
  EXPECT_DOUBLE_EQ(distanceToLine(kDown, {0.1, 0.0, 1.0}, {0.1, 0.0, 1.0}, 0.2), 4.0) << "one point";
}

TEST(SceneRay, meetsABoxWhereItMeetsATriangleInIt) {
  std::mt19937 random(1);
  const auto place = [&] {
    std::uniform_real_distribution<double> real(-1.0, 1.0);
    return glm::dvec3(real(random), real(random), real(random));
  };
  int met = 0;
  for (int i = 0; i < 20000; ++i) {
    const SceneRay ray{3.0 * place(), glm::normalize(place())};
    const glm::dvec3 a = place(), b = place(), c = place();
    const double distance = distanceToTriangle(ray, a, b, c);
    if (std::isinf(distance)) continue;
    base::Aabb box;
    for (const glm::dvec3& corner : {a, b, c}) box.add(glm::vec3(corner));
    EXPECT_TRUE(meetsBox(ray, box, distance + 1e-5));
    ++met;
  }
  EXPECT_GT(met, 50);
  base::Aabb box;
  box.add(glm::vec3(-1.0F, -1.0F, 0.0F));
  box.add(glm::vec3(1.0F, 1.0F, 1.0F));
  EXPECT_TRUE(meetsBox(kDown, box, 4.1));
  EXPECT_FALSE(meetsBox(kDown, box, 3.9)) << "something lies before it";
  EXPECT_FALSE(meetsBox({{2.0, 0.0, 5.0}, {0.0, 0.0, -1.0}}, box, 100.0));
}

TEST(SceneRay, aHitIsTheNearestThatNoSectionCutsAway) {
  RayHit hit{kDown};
  EXPECT_FALSE(hit.place());
  hit.keep(4.0);
  hit.keep(2.0);
  hit.keep(3.0);
  EXPECT_EQ(hit.place(), glm::vec3(0.0F, 0.0F, 3.0F));
  RayHit cut{kDown, glm::vec4(0.0F, 0.0F, 1.0F, 1.5F)};
  cut.keep(2.0);
  EXPECT_FALSE(cut.place());
  cut.keep(4.0);
  EXPECT_EQ(cut.place(), glm::vec3(0.0F, 0.0F, 1.0F));
}

}  // namespace
}  // namespace client
