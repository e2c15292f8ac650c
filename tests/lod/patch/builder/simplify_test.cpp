#include "lod/patch/builder/simplify.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "base/geometry.h"
#include "tests/lod/patch/builder/simplify_in_place.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::patch::builder;
using support::Mesh;

// Puts a generated mesh on the lattice, with `scale` steps to the unit.
GroupMesh groupOf(const Mesh& mesh, float scale) {
  GroupMesh group;
  for (const glm::vec3& p : mesh.positions) group.positions.push_back(glm::round((p + 2.0F) * scale));
  group.normals.assign(group.positions.size(), glm::vec3(0, 0, 1));
  for (const auto& c : mesh.colors) group.colors.push_back(glm::vec3(glm::u8vec3(c)));
  group.locked.assign(group.positions.size(), 0);
  group.indices = mesh.indices;
  return group;
}

int unbalancedEdges(const std::vector<std::uint32_t>& indices) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> balance;
  for (std::size_t i = 0; i < indices.size(); i += 3)
    for (std::size_t k = 0; k < 3; ++k)
      ++balance[{indices[i + k], indices[i + (k + 1) % 3]}], --balance[{indices[i + (k + 1) % 3], indices[i + k]}];
  int open = 0;
  for (const auto& [edge, count] : balance) open += count > 0 ? count : 0;
  return open;
}

TEST(Simplify, closedStaysClosedAndManifoldWhenHalved) {
  GroupMesh group = groupOf(support::torus(60, 40), 500.0F);
  const CollapseHistory out = simplifyInPlace(group, 2400);
  EXPECT_LE(out.indices.size() / 3, 2400U);
  EXPECT_GE(out.indices.size() / 3, 2398U);
  EXPECT_FALSE(out.rough);
  EXPECT_EQ(unbalancedEdges(out.indices), 0);
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (std::size_t i = 0; i < out.indices.size(); i += 3)
    for (std::size_t k = 0; k < 3; ++k) ++uses[std::minmax(out.indices[i + k], out.indices[i + (k + 1) % 3])];
  for (const auto& [edge, count] : uses) ASSERT_EQ(count, 2);
}

TEST(Simplify, lockedVerticesStayWhereTheyAre) {
  GroupMesh group = groupOf(support::openGrid(40), 1000.0F);
  for (std::uint32_t v = 0; v < group.positions.size(); ++v)
    group.locked[v] = v % 41 == 0 || v % 41 == 40 || v < 41 || v >= 41 * 40;
  const GroupMesh before = group;
  const CollapseHistory out = simplifyInPlace(group, 800);
  EXPECT_LE(out.indices.size() / 3, 800U);
  std::vector<bool> used(group.positions.size(), false);
  for (const std::uint32_t v : out.indices) used[v] = true;
  for (std::uint32_t v = 0; v < group.positions.size(); ++v) {
    if (before.locked[v] == 0) continue;
    EXPECT_TRUE(used[v]);
    EXPECT_EQ(out.survivor[v], v);
    EXPECT_EQ(group.positions[v], before.positions[v]);
  }
}

// The cost of colours is scaled by the mean edge; edges that cannot collapse do not count, however long they are.
TEST(Simplify, lockedTrianglesHaveNoSayInWhatTheOthersBecome) {
  GroupMesh alone = groupOf(support::torus(60, 40), 500.0F);
  alone.colors.clear();
  for (std::uint32_t v = 0; v < alone.positions.size(); ++v)
    alone.colors.push_back({static_cast<float>(v * 37 % 256), static_cast<float>(v * 91 % 256), 0.0F});
  GroupMesh beside = alone;
  for (const glm::vec3& p :
       {glm::vec3(0, 0, 100'000), glm::vec3(100'000, 0, 100'000), glm::vec3(0, 100'000, 100'000)}) {
    beside.indices.push_back(static_cast<std::uint32_t>(beside.positions.size()));
    beside.positions.push_back(p);
    beside.normals.push_back({0, 0, 1});
    beside.colors.push_back({0, 0, 0});
    beside.locked.push_back(1);
  }
  const CollapseHistory expected = simplifyInPlace(alone, 2400);
  const CollapseHistory out = simplifyInPlace(beside, 2401);
  ASSERT_EQ(out.indices.size(), expected.indices.size() + 3);
  EXPECT_TRUE(std::equal(expected.indices.begin(), expected.indices.end(), out.indices.begin()));
  EXPECT_TRUE(std::equal(alone.positions.begin(), alone.positions.end(), beside.positions.begin()));
}

TEST(Simplify, aFlatOpenBorderKeepsItsOutline) {
  GroupMesh group = groupOf(support::openGrid(30, 0.0F), 900.0F);
  const CollapseHistory out = simplifyInPlace(group, 40);
  EXPECT_LE(out.indices.size() / 3, 40U);
  double area = 0.0;
  for (std::size_t i = 0; i < out.indices.size(); i += 3) {
    const glm::vec3 a = group.positions[out.indices[i]];
    area += 0.5 * glm::cross(group.positions[out.indices[i + 1]] - a, group.positions[out.indices[i + 2]] - a).z;
  }
  EXPECT_DOUBLE_EQ(area, 900.0 * 900.0);
}

double distanceTo(const GroupMesh& group, const CollapseHistory& result, const glm::vec3& p) {
  double nearest2 = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < result.indices.size(); i += 3) {
    const auto corner = [&](std::size_t k) { return glm::dvec3(group.positions[result.indices[i + k]]); };
    const glm::dvec3 d = glm::dvec3(p) - base::closestPointOnTriangle(glm::dvec3(p), corner(0), corner(1), corner(2));
    nearest2 = std::min(nearest2, glm::dot(d, d));
  }
  return std::sqrt(nearest2);
}

// On a plane every collapse costs nothing, and short edges go first: no fans of slivers remain.
TEST(Simplify, aFlatSheetIsLeftInTrianglesOfAboutEqualSides) {
  GroupMesh group = groupOf(support::openGrid(100), 4000.0F);
  for (glm::vec3& p : group.positions) p.z = 5.0F;
  const CollapseHistory out = simplifyInPlace(group, 2000);
  EXPECT_LE(out.indices.size() / 3, 2000U);
  std::size_t slivers = 0;
  for (std::size_t i = 0; i < out.indices.size(); i += 3) {
    const glm::dvec3 a(group.positions[out.indices[i]]);
    const glm::dvec3 ab = glm::dvec3(group.positions[out.indices[i + 1]]) - a;
    const glm::dvec3 ac = glm::dvec3(group.positions[out.indices[i + 2]]) - a;
    const double longest2 = std::max({glm::dot(ab, ab), glm::dot(ac, ac), glm::dot(ac - ab, ac - ab)});
    slivers += longest2 > 10.0 * glm::length(glm::cross(ab, ac)) ? 1 : 0;
  }
  EXPECT_LE(slivers, 0U);
}

// The planes of a needle's sides nearly contain its axis, so distances from them would let it vanish on any rough
// ground.
TEST(Simplify, needlesOutliveTheRoughGroundTheyStandOn) {
  constexpr std::uint32_t kRow = 41;
  GroupMesh group = groupOf(support::openGrid(40, 0.0F), 4000.0F);
  std::mt19937 random(3);
  std::uniform_int_distribution<int> height(0, 60);
  for (glm::vec3& p : group.positions) p.z += static_cast<float>(height(random));
  std::vector<glm::vec3> tips;
  for (std::uint32_t y = 4; y < 40; y += 8)
    for (std::uint32_t x = 4; x < 40; x += 8) {
      const glm::vec3 foot = group.positions[y * kRow + x];
      for (std::uint32_t v : {-kRow - 1, -kRow, -kRow + 1, ~0U, 1U, kRow - 1, kRow, kRow + 1}) {
        glm::vec3& p = group.positions[y * kRow + x + v];
        p = glm::round(glm::mix(foot, p, 0.1F));
      }
      group.positions[y * kRow + x].z += 400.0F;
      tips.push_back(group.positions[y * kRow + x]);
    }
  const CollapseHistory out = simplifyInPlace(group, 2 * 3200 / 5);
  for (const glm::vec3& tip : tips) EXPECT_LT(distanceTo(group, out, tip), 60.0);
}

// By area times squared height the wide cone counts more than the small one, which is three times as high.
TEST(Simplify, theTipOfASmallFanOutlivesALowerOneOfAWide) {
  GroupMesh group;
  const auto addCone = [&](const glm::vec3& middle, float radius, float height) {
    const auto tip = static_cast<std::uint32_t>(group.positions.size());
    group.positions.push_back(middle + glm::vec3(0, 0, height));
    group.locked.push_back(0);
    for (std::uint32_t i = 0; i < 6; ++i) {
      const float angle = glm::radians(60.0F * static_cast<float>(i));
      group.positions.push_back(glm::round(middle + radius * glm::vec3(std::cos(angle), std::sin(angle), 0.0F)));
      group.locked.push_back(1);
      group.indices.insert(group.indices.end(), {tip, tip + 1 + i, tip + 1 + (i + 1) % 6});
    }
    return tip;
  };
  const std::uint32_t small = addCone({1000, 1000, 100}, 100.0F, 30.0F);
  const std::uint32_t wide = addCone({3000, 1000, 100}, 400.0F, 10.0F);
  group.normals.assign(group.positions.size(), glm::vec3(0, 0, 1));
  const CollapseHistory out = simplifyInPlace(group, 10);
  EXPECT_EQ(out.indices.size() / 3, 10U);
  EXPECT_EQ(out.survivor[small], small);
  EXPECT_NE(out.survivor[wide], wide);
}

TEST(Simplify, stillHalvesSoupWhereNothingIsShared) {
  GroupMesh group = groupOf(support::triangleSoup(2000), 20000.0F);
  const CollapseHistory out = simplifyInPlace(group, 1000);
  EXPECT_EQ(out.indices.size() / 3, 1000U);
}

TEST(Simplify, neverRemovesTheLastTriangle) {
  GroupMesh group = groupOf(support::triangleSoup(3), 20000.0F);
  EXPECT_GE(simplifyInPlace(group, 1).indices.size(), 3U);
  GroupMesh tetrahedron = groupOf(support::tinyComponents(1), 20000.0F);
  EXPECT_GE(simplifyInPlace(tetrahedron, 1).indices.size(), 3U);
}

// The lone triangle that lies near others vanishes first, since a component costs its distance to what remains.
TEST(Simplify, aFarComponentOutlivesANearOne) {
  GroupMesh group;
  auto add = [&](const glm::vec3& at, float size) {
    for (const glm::vec3& d : {glm::vec3(0), glm::vec3(size, 0, 0), glm::vec3(0, size, 0)}) {
      group.indices.push_back(static_cast<std::uint32_t>(group.positions.size()));
      group.positions.push_back(at + d);
    }
  };
  add({0, 0, 0}, 100), add({10, 10, 8}, 40), add({5000, 0, 0}, 10);
  group.normals.assign(9, glm::vec3(0, 0, 1));
  group.locked.assign(9, 0);
  const CollapseHistory out = simplifyInPlace(group, 2);
  EXPECT_EQ(out.origin, (std::vector<std::uint32_t>{0, 2}));
}

// Distances are measured to what remains, not to components that have vanished.
TEST(Simplify, theLastOfAFarClusterOutlivesTheRest) {
  GroupMesh group = groupOf(support::bumpySphere(20, 30), 700.0F);
  const std::size_t sphere = group.indices.size() / 3;
  const auto far = static_cast<float>(1 << 20);
  for (int i = 0; i < 8; ++i)
    for (const glm::vec3& d : {glm::vec3(0), glm::vec3(6, 0, 0), glm::vec3(0, 6, 0)}) {
      group.indices.push_back(static_cast<std::uint32_t>(group.positions.size()));
      group.positions.push_back(glm::vec3(far, far + static_cast<float>(4 * i), far) + d);
      group.normals.emplace_back(0, 0, 1);
      group.locked.push_back(0);
    }
  const CollapseHistory out = simplifyInPlace(group, 100);
  EXPECT_LE(out.origin.size(), 100U);
  EXPECT_TRUE(std::any_of(out.origin.begin(), out.origin.end(), [&](std::uint32_t t) { return t >= sphere; }));
}

// Flaps (both sides of one upright triangle) stand on every second edge of a row. Where a foot collapses the flap
// vanishes, and no plane tells that. The few tall ones are the last to vanish.
TEST(Simplify, tallFlapsOutliveLowOnes) {
  constexpr std::uint32_t kRow = 41;
  GroupMesh group = groupOf(support::openGrid(40, 0.0F), 4000.0F);
  std::vector<glm::vec3> tall;
  for (std::uint32_t y = 1; y < 40; y += 2)
    for (std::uint32_t x = 1; x + 1 < 40; x += 3) {
      const std::uint32_t a = y * kRow + x;
      const bool is_tall = (x * 7 + y) % 17 == 0;
      const glm::vec3 foot = 0.5F * (group.positions[a] + group.positions[a + 1]);
      const auto top = static_cast<std::uint32_t>(group.positions.size());
      group.positions.push_back(glm::round(foot + glm::vec3(0, 0, is_tall ? 2000.0F : 20.0F)));
      group.normals.push_back({0, 1, 0});
      group.locked.push_back(0);
      group.indices.insert(group.indices.end(), {a, a + 1, top, a + 1, a, top});
      if (is_tall) tall.push_back(group.positions.back());
    }
  ASSERT_GT(tall.size(), 10U);
  const CollapseHistory out = simplifyInPlace(group, group.indices.size() / 3 / 10);
  for (const glm::vec3& top : tall) EXPECT_LT(distanceTo(group, out, top), 100.0);
}

TEST(Simplify, theWorkIsRecorded) {
  GroupMesh group = groupOf(support::bumpySphere(20, 30), 700.0F);
  const CollapseHistory out = simplifyInPlace(group, 500);
  ASSERT_EQ(out.origin.size(), out.indices.size() / 3);
  const Mesh source = support::bumpySphere(20, 30);
  for (std::size_t t = 0; t < out.origin.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(out.survivor[source.indices[3 * std::size_t{out.origin[t]} + k]], out.indices[3 * t + k]);
}

}  // namespace
