#include "lod/patch/hull.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <glm/gtc/constants.hpp>
#include <glm/gtx/rotate_vector.hpp>
#include <limits>
#include <random>

#include "tests/support/test_meshes.h"

namespace lod::patch {
namespace {

using Triangles = std::vector<std::array<glm::vec3, 3>>;

Triangles trianglesOf(const support::Mesh& mesh) {
  Triangles all;
  for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3)
    all.push_back(
        {mesh.positions[mesh.indices[i]], mesh.positions[mesh.indices[i + 1]], mesh.positions[mesh.indices[i + 2]]});
  return all;
}

/// A slab with these half sides, turned about two axes.
const glm::vec3 kHalf(4.0F, 1.0F, 0.3F);
glm::vec3 turned(const glm::vec3& p) {
  return glm::rotateY(glm::rotateZ(p, 0.7F), 0.5F);
}
glm::vec3 turnedBack(const glm::vec3& p) {
  return glm::rotateZ(glm::rotateY(p, -0.5F), -0.7F);
}
Triangles slab() {
  Triangles all;
  for (int axis = 0; axis < 3; ++axis)
    for (const float side : {-1.0F, 1.0F}) {
      const auto corner = [&](float u, float v) {
        glm::vec3 p;
        p[axis] = side, p[(axis + 1) % 3] = u, p[(axis + 2) % 3] = v;
        return turned(p * kHalf);
      };
      all.push_back({corner(-1, -1), corner(1, -1), corner(1, 1)});
      all.push_back({corner(-1, -1), corner(1, 1), corner(-1, 1)});
    }
  return all;
}

std::vector<glm::vec3> hullOf(const Triangles& triangles, float reach = 0.0F) {
  std::vector<SurfacePart> parts;
  for (const auto& t : triangles) parts.push_back(trianglePart(t, reach));
  return findHull(parts);
}

float endOf(const std::vector<glm::vec3>& points, const glm::vec3& direction) {
  float end = std::numeric_limits<float>::lowest();
  for (const glm::vec3& p : points) end = std::max(end, glm::dot(p, direction));
  return end;
}

/// The hull ends nowhere before the surface, and at most by these shares of the surface's size off it.
void expectAround(const std::vector<glm::vec3>& hull, const Triangles& surface, float inside, float outside) {
  std::vector<glm::vec3> corners;
  for (const auto& t : surface) corners.insert(corners.end(), t.begin(), t.end());
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  ASSERT_LE(hull.size(), kMaxHullPoints);
  for (int i = 0; i < 1000; ++i) {
    const glm::vec3 direction = glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
    const float end = endOf(corners, direction);
    const float size = end + endOf(corners, -direction);
    ASSERT_GE(endOf(hull, direction), end - inside * size) << i;
    ASSERT_LE(endOf(hull, direction), end + outside * size) << i;
  }
}

Triangles ball() {
  return trianglesOf(support::bumpySphere(60, 60, 0.02F));
}

/// Its radius is 1.
Triangles smallBall() {
  return trianglesOf(support::bumpySphere(16, 16, 0.0F));
}

TEST(Hull, ofASlantedSlabIsTheSlabAndNotTheBoxAroundIt) {
  const auto hull = hullOf(slab());
  expectAround(hull, slab(), 0.01F, 0.011F);
  for (const glm::vec3& p : hull)
    EXPECT_TRUE(glm::all(glm::lessThanEqual(glm::abs(turnedBack(p)), 1.03F * kHalf)))
        << p.x << ' ' << p.y << ' ' << p.z;
}

TEST(Hull, holdsWhatIsRound) {
  expectAround(hullOf(ball()), ball(), 0.02F, 0.07F);
  Triangles lens = ball();
  for (auto& t : lens)
    for (glm::vec3& p : t) p.z *= 0.05F;
  expectAround(hullOf(lens), lens, 0.02F, 0.07F);
}

TEST(Hull, holdsWhatIsFlatALineOrAPoint) {
  for (const glm::vec3& scale : {glm::vec3(1, 1, 0), glm::vec3(0, 1, 0), glm::vec3(0)}) {
    Triangles flat = ball();
    for (auto& t : flat)
      for (glm::vec3& p : t) p = scale * p + glm::vec3(1.0F, 2.0F, 3.0F);
    const auto hull = hullOf(flat);
    ASSERT_FALSE(hull.empty());
    expectAround(hull, flat, 0.02F, 0.07F);
    for (const glm::vec3& p : hull) EXPECT_EQ(p.z, 3.0F);
  }
}

TEST(Hull, leavesOutStraysEvenWhereAnotherDirectionDoesNotTellThem) {
  Triangles with = ball();
  const auto hull = hullOf(with);
  // Along y the first one is just above the ball.
  for (const glm::vec3& at : {glm::vec3(100.0F, 1.1F, 0.0F), glm::vec3(-3.0F, -3.0F, 2.0F)})
    with.push_back({at, at + glm::vec3(0.01F, 0, 0), at + glm::vec3(0, 0.01F, 0)});
  EXPECT_EQ(hullOf(with), hull);
}

TEST(Hull, holdsASpearAndLooseAndLargeParts) {
  const auto expectHeld = [](const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    Triangles with = ball();
    with.push_back({a, b, c});
    expectAround(hullOf(with), with, 0.02F, 0.1F);
  };
  // A spear begins in the ball, and has next to no area.
  expectHeld({0.0F, 0.0F, 0.9F}, {0.001F, 0.0F, 0.9F}, {0.0F, 0.0F, 9.0F});
  expectHeld({1.4F, 0.0F, 0.0F}, {1.41F, 0.0F, 0.0F}, {1.4F, 0.01F, 0.0F});
  expectHeld({50.0F, 0.0F, 0.0F}, {50.0F, 1.0F, 0.0F}, {50.0F, 0.0F, 1.0F});
}

TEST(Hull, isEmptyWithoutTriangles) {
  EXPECT_TRUE(findHull({}).empty());
}

TEST(Hull, holdsAsFarAsTheSurfaceMayLieOffItsTriangles) {
  constexpr float kReach = 0.2F;
  Triangles thick;
  for (const auto& t : slab())
    for (const glm::vec3& p : t)
      for (const auto& around : smallBall()) thick.push_back({p + kReach * around[0], p + kReach * around[1], p});
  expectAround(hullOf(slab(), kReach), thick, 0.02F, 0.07F);
}

TEST(Hull, ofBallsHoldsThemAndNotTheirBox) {
  // A slanted line of balls of several sizes, the largest at one end.
  std::vector<SurfacePart> parts;
  Triangles surface;
  for (int i = 0; i <= 40; ++i) {
    const glm::vec3 center = turned({0.25F * static_cast<float>(i), 0.0F, 0.0F});
    const float radius = i == 0 ? 1.0F : 0.1F + 0.005F * static_cast<float>(i % 7);
    parts.push_back(ballPart(center, radius));
    for (const auto& t : smallBall()) surface.push_back({center + radius * t[0], center, center});
  }
  const auto hull = findHull(parts);
  expectAround(hull, surface, 0.03F, 0.1F);
  for (const glm::vec3& p : hull) EXPECT_LT(glm::length(glm::vec2(turnedBack(p).y, turnedBack(p).z)), 1.2F);
}

TEST(Hull, leavesOutStrayBalls) {
  std::vector<SurfacePart> parts;
  for (const auto& t : ball()) parts.push_back(ballPart(t[0], 0.03F));
  const auto hull = findHull(parts);
  parts.push_back(ballPart({5.0F, 0.0F, 0.0F}, 0.03F));
  EXPECT_EQ(findHull(parts), hull);
  parts.push_back(ballPart({5.0F, 0.0F, 0.0F}, 1.0F));
  EXPECT_GT(endOf(findHull(parts), {1.0F, 0.0F, 0.0F}), 5.9F) << "too large for a stray";
}

}  // namespace
}  // namespace lod::patch
