#include "lod/patch/builder/coarse_positions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <tuple>

#include "tests/lod/patch/builder/built_cut.h"
#include "tests/lod/patch/builder/simplify_in_place.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::patch::builder;

// A simplified torus of some 800 triangles, 4000 lattice steps wide.
SimplifiedGroup simplifiedTorus(const std::vector<std::uint8_t>& locked) {
  const support::Mesh mesh = support::torus(60, 40);
  GroupMesh group;
  for (const glm::vec3& p : mesh.positions) group.positions.push_back(glm::round((p + 2.0F) * 1000.0F));
  group.normals.assign(group.positions.size(), glm::vec3(0, 0, 1));
  group.locked = locked;
  group.indices = mesh.indices;
  FacetSurface surface;
  surface.reset({group.positions, group.indices});
  return simplifyGroup(group, surface, 800);
}

glm::vec3 normalOf(const SimplifiedGroup& group, std::size_t t) {
  const auto at = [&](std::size_t k) { return group.vertices.positions[group.history.indices[3 * t + k]]; };
  return glm::cross(at(1) - at(0), at(2) - at(0));
}

TEST(CoarsePositions, spareBitsFollowTheError) {
  EXPECT_EQ(spareBits(0.0), 0);
  EXPECT_EQ(spareBits(0.5), 0);
  for (double error = 1.0; error < 8000.0; error *= 1.07) {
    const double step = std::exp2(spareBits(error));
    EXPECT_LE(step, 3.0 * error);
    EXPECT_GT(2.0 * step, 3.0 * error);
  }
  EXPECT_EQ(spareBits(1e30), 15);
  EXPECT_EQ(spareBits(std::numeric_limits<double>::infinity()), 15);
}

TEST(CoarsePositions, freeVerticesMoveToMultiplesAndLockedOnesStay) {
  std::vector<std::uint8_t> locked(60 * 40, 0);
  for (std::size_t v = 0; v < locked.size(); v += 20) locked[v] = 1;
  const SimplifiedGroup before = simplifiedTorus(locked);
  const glm::ivec3 corner(1005, 333, 7);
  SimplifiedGroup after = before;
  coarsenPositions(after, locked, corner, 4);
  EXPECT_EQ(after.history.indices, before.history.indices);

  std::set<std::tuple<float, float, float>> places;
  std::set<std::uint32_t> used(after.history.indices.begin(), after.history.indices.end());
  std::size_t moved = 0, held = 0;
  for (const std::uint32_t v : used) {
    const glm::vec3& p = after.vertices.positions[v];
    EXPECT_TRUE(places.insert({p.x, p.y, p.z}).second);
    if (locked[v] != 0) {
      EXPECT_EQ(p, before.vertices.positions[v]);
      continue;
    }
    const glm::ivec3 q = corner + glm::ivec3(p);
    const bool coarse = ((q.x | q.y | q.z) & 15) == 0;
    ++(coarse ? moved : held);
    const glm::vec3 way = glm::abs(p - before.vertices.positions[v]);
    EXPECT_LE(std::max({way.x, way.y, way.z}), 8.0F);
    EXPECT_TRUE(coarse || way == glm::vec3(0.0F));
  }
  EXPECT_GT(moved, 100U);
  EXPECT_LE(held, moved / 20);
  for (std::size_t t = 0; 3 * t < after.history.indices.size(); ++t)
    EXPECT_GT(glm::dot(normalOf(before, t), normalOf(after, t)), 0.0F);
}

TEST(CoarsePositions, noTriangleTurnsOverAndNoVerticesMeet) {
  // Steps are as long as edges, so that most moves would do one or the other.
  const std::vector<std::uint8_t> locked(60 * 40, 0);
  const SimplifiedGroup before = simplifiedTorus(locked);
  SimplifiedGroup after = before;
  coarsenPositions(after, locked, glm::ivec3(0), 8);
  std::set<std::uint32_t> used(after.history.indices.begin(), after.history.indices.end());
  std::set<std::tuple<float, float, float>> places;
  std::size_t moved = 0;
  for (const std::uint32_t v : used) {
    const glm::vec3& p = after.vertices.positions[v];
    EXPECT_TRUE(places.insert({p.x, p.y, p.z}).second);
    moved += p != before.vertices.positions[v] ? 1 : 0;
  }
  EXPECT_GT(moved, 20U);
  EXPECT_LT(moved, used.size());
  for (std::size_t t = 0; 3 * t < after.history.indices.size(); ++t)
    EXPECT_GE(glm::dot(normalOf(before, t), normalOf(after, t)),
              0.2499F * glm::dot(normalOf(before, t), normalOf(before, t)))
        << t;
}

// Levels that are far off say fewer bits of their positions; the leaves say all.
TEST(CoarsePositions, coarseLevelsOfAHierarchyTakeFewerBits) {
  support::Mesh mesh = support::torus(400, 300);
  std::mt19937 random(2);
  std::normal_distribution<float> noise(0.0F, 0.002F);
  for (glm::vec3& p : mesh.positions) p += glm::vec3(noise(random), noise(random), noise(random));
  const auto built = support::builtHierarchy(mesh, {});
  ASSERT_TRUE(built) << built.error().message;
  const lod::patch::Hierarchy& h = built->hierarchy;
  std::size_t coarse = 0, all = 0;
  for (std::uint32_t p = 0; p < h.patches.size(); ++p) {
    const auto bits = lod::patch::encodePatch(built->geometry[p])[1] >> 4;
    EXPECT_TRUE(h.patches[p].level > 0 || bits == 0);
    if (h.patches[p].level < 3) continue;
    ++all;
    coarse += bits >= 2 ? 1 : 0;
  }
  EXPECT_GT(all, 3U);
  EXPECT_EQ(coarse, all);
}

}  // namespace
