#include "base/geometry.h"

#include <gtest/gtest.h>

#include <glm/gtc/matrix_transform.hpp>
#include <random>

namespace {

std::mt19937 rng(17);
float uniform(float a, float b) {
  return a + (b - a) * static_cast<float>(rng() % 100001) / 100000.0F;
}
glm::vec3 randomPoint(float range) {
  return {uniform(-range, range), uniform(-range, range), uniform(-range, range)};
}

TEST(BoundingSphere, containsEveryPointAndIsNotMuchTooLarge) {
  for (int round = 0; round < 200; ++round) {
    std::vector<glm::vec3> points(1 + rng() % 50);
    const glm::vec3 offset = randomPoint(1000.0F);
    base::Aabb box;
    for (auto& p : points) p = offset + randomPoint(1.0F), box.add(p);
    const base::Sphere sphere = base::boundingSphere(points);
    for (const auto& p : points) EXPECT_LE(glm::length(p - sphere.center), sphere.radius);
    EXPECT_LE(sphere.radius, 0.5F * box.diagonal() * 1.2F + 1e-3F);
  }
}

TEST(BoundingSphere, containsEverySphere) {
  for (int round = 0; round < 200; ++round) {
    std::vector<base::Sphere> spheres(1 + rng() % 10);
    for (auto& s : spheres) s = {randomPoint(10.0F), uniform(0.0F, 3.0F)};
    const base::Sphere all = base::boundingSphere(spheres);
    for (const auto& s : spheres) EXPECT_LE(glm::length(s.center - all.center) + s.radius, all.radius);
  }
}

TEST(NormalCone, neverCullsASurfaceElementThatFacesTheEye) {
  int culled = 0;
  for (int round = 0; round < 3000; ++round) {
    const glm::vec3 axis = glm::normalize(randomPoint(1.0F) + glm::vec3(0, 0, 1e-3F));
    std::vector<glm::vec3> normals(8);
    for (auto& n : normals) n = glm::normalize(axis + 0.4F * randomPoint(1.0F));
    const base::Sphere bounds{randomPoint(1.0F), 0.5F};
    const glm::vec3 eye = randomPoint(6.0F);
    if (!base::facesAway(base::boundingCone(normals), bounds, eye)) continue;
    ++culled;
    for (int s = 0; s < 20; ++s) {
      const glm::vec3 p =
          bounds.center + bounds.radius * glm::normalize(randomPoint(1.0F) + glm::vec3(1e-3F)) * uniform(0.0F, 1.0F);
      for (const auto& n : normals) EXPECT_LE(glm::dot(n, eye - p), 1e-4F);
    }
  }
  EXPECT_GT(culled, 200) << "a cone that culls nothing proves nothing";
}

TEST(Frustum, keepsEveryBoxWithAVisiblePoint) {
  const glm::mat4 clip =
      glm::perspective(1.0F, 1.5F, 0.1F, 50.0F) * glm::lookAt(glm::vec3(1, 2, 3), glm::vec3(0), glm::vec3(0, 1, 0));
  const base::Frustum frustum(clip);
  int outside = 0;
  for (int round = 0; round < 3000; ++round) {
    const glm::vec3 p = randomPoint(8.0F);
    base::Aabb box;
    box.add(p);
    box.add(p + glm::abs(randomPoint(0.5F)));
    const glm::vec4 c = clip * glm::vec4(p, 1.0F);
    const bool visible = std::abs(c.x) <= c.w && std::abs(c.y) <= c.w && std::abs(c.z) <= c.w;
    EXPECT_TRUE(!visible || frustum.mayOverlap(box));
    if (!frustum.mayOverlap(box)) ++outside;
  }
  EXPECT_GT(outside, 500);
}

TEST(ClosestPointOnTriangle, beatsEverySampledPoint) {
  for (int round = 0; round < 300; ++round) {
    const glm::dvec3 a(randomPoint(1.0F)), b(randomPoint(1.0F)), c(randomPoint(1.0F)), p(randomPoint(2.0F));
    const double best = glm::length(base::closestPointOnTriangle(p, a, b, c) - p);
    for (int i = 0; i <= 10; ++i)
      for (int j = 0; i + j <= 10; ++j) {
        const glm::dvec3 q = a + (b - a) * (i / 10.0) + (c - a) * (j / 10.0);
        EXPECT_LE(best, glm::length(q - p) + 1e-12);
      }
  }
}

TEST(ClosestPointOnTriangle, holdsOnDegenerateTriangles) {
  const glm::dvec3 a(0, 0, 0), b(2, 0, 0);
  EXPECT_NEAR(glm::length(base::closestPointOnTriangle({1, 1, 0}, a, b, b) - glm::dvec3(1, 0, 0)), 0.0, 1e-12);
  EXPECT_EQ(base::closestPointOnTriangle({1, 1, 0}, a, a, a), a);
}

// The table of docs/formats/scene.md, "North".
TEST(NorthDirection, isClockwiseFromTheReferenceOfEachUp) {
  struct Row {
    glm::dvec3 up, at_0, at_90;
  };
  for (const Row& row : {Row{{0, 0, 1}, {0, 1, 0}, {1, 0, 0}}, Row{{0, 0, -1}, {0, -1, 0}, {1, 0, 0}},
                         Row{{0, 1, 0}, {0, 0, -1}, {1, 0, 0}}, Row{{0, -1, 0}, {0, 0, 1}, {1, 0, 0}},
                         Row{{1, 0, 0}, {0, 0, 1}, {0, 1, 0}}, Row{{-1, 0, 0}, {0, 0, -1}, {0, 1, 0}}}) {
    EXPECT_LT(glm::length(base::northDirection(row.up, 0.0) - row.at_0), 1e-12);
    EXPECT_LT(glm::length(base::northDirection(3.0 * row.up, 90.0) - row.at_90), 1e-12);
    EXPECT_LT(glm::length(base::northDirection(row.up, -180.0) + row.at_0), 1e-12);
    // Seen from above, right of the reference is clockwise.
    EXPECT_GT(glm::dot(glm::cross(row.at_0, row.up), row.at_90), 0.99);
  }
  const glm::dvec3 leaning = glm::normalize(glm::dvec3(0.2, -0.3, 0.9));
  const glm::dvec3 north = base::northDirection(leaning, 12.0);
  EXPECT_NEAR(glm::length(north), 1.0, 1e-12);
  EXPECT_NEAR(glm::dot(north, leaning), 0.0, 1e-12);
}

}  // namespace
