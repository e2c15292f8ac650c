// Triangles are wound alike within a bucket and across buckets.
#include <gtest/gtest.h>

#include <random>

#include "tests/support/built_hierarchy.h"

namespace {

using support::BuiltHierarchy;
using support::Mesh;

// Returns a sphere of n rings of 2 n quads.
Mesh sphere(int n) {
  Mesh mesh;
  const int across = 2 * n;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j < across; ++j) {
      const double a = 3.14159265358979 * i / n, b = 6.28318530717959 * j / across;
      mesh.positions.emplace_back(glm::dvec3(std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)));
    }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < across; ++j) {
      const auto at = [&](int y, int x) { return static_cast<std::uint32_t>(y * across + x % across); };
      const std::uint32_t a = at(i, j), b = at(i, j + 1), c = at(i + 1, j), d = at(i + 1, j + 1);
      if (i > 0) mesh.indices.insert(mesh.indices.end(), {a, c, b});
      if (i + 1 < n) mesh.indices.insert(mesh.indices.end(), {b, c, d});
    }
  return mesh;
}

// Counts the leaf triangles that face the sphere's centre.
std::size_t facingInward(const BuiltHierarchy& built) {
  std::size_t inward = 0;
  for (std::size_t p = 0; p < built.geometry.size(); ++p) {
    if (built.hierarchy.patches[p].level != 0) continue;
    const auto& g = built.geometry[p];
    for (std::size_t i = 0; i < g.indices.size(); i += 3) {
      const auto point = [&](std::size_t k) {
        return glm::dvec3(built.hierarchy.lattice.position(g.positions[g.indices[i + k]]));
      };
      const glm::dvec3 a = point(0);
      if (glm::dot(glm::cross(point(1) - a, point(2) - a), a) < 0.0) ++inward;
    }
  }
  return inward;
}

TEST(Winding, flippedTrianglesFollowTheMajorityAcrossBuckets) {
  // The sphere fills more than two buckets; a random tenth of its triangles are flipped.
  Mesh mesh = sphere(400);
  ASSERT_GT(mesh.positions.size(), std::size_t{300'000});
  std::minstd_rand random(7);
  std::uint64_t turned = 0;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3)
    if (random() % 10 == 0) std::swap(mesh.indices[i], mesh.indices[i + 1]), ++turned;
  const auto built = support::builtHierarchy(mesh, {});
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_EQ(facingInward(*built), 0U);
  const auto& counts = built->summary.repairs.counts;
  ASSERT_TRUE(counts.contains("flipped_triangles"));
  // Some triangles near the poles collapse on the lattice.
  EXPECT_NEAR(static_cast<double>(counts.at("flipped_triangles")), static_cast<double>(turned), 2000.0);
}

TEST(Winding, flipsALargePartWoundTheOtherWayAsAWhole) {
  Mesh mesh = sphere(400);
  for (std::size_t i = 0; i < mesh.indices.size() / 5 / 3 * 3; i += 3) std::swap(mesh.indices[i], mesh.indices[i + 1]);
  const auto built = support::builtHierarchy(mesh, {});
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_EQ(facingInward(*built), 0U);
}

TEST(Winding, edgesThatCoincideByChanceFlipNothing) {
  // Two flat tiles wound alike that overlap at one edge: both have a border edge from (60, 0) to (60, 1).
  Mesh mesh;
  const auto tile = [&mesh](float x0, float bend) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    for (int y = 0; y <= 60; ++y)
      for (int x = 0; x <= 60; ++x)
        mesh.positions.emplace_back(x0 + static_cast<float>(x), y, y > 1 ? bend * static_cast<float>(y) : 0.0F);
    for (std::uint32_t y = 0; y < 60; ++y)
      for (std::uint32_t x = 0; x < 60; ++x) {
        const std::uint32_t a = first + 61 * y + x;
        mesh.indices.insert(mesh.indices.end(), {a, a + 1, a + 61, a + 1, a + 62, a + 61});
      }
  };
  tile(0.0F, 0.0F);
  const std::size_t half = mesh.positions.size();
  tile(0.0F, 0.5F);
  // The second lies behind the first's right border and runs along it in the same direction.
  for (std::size_t v = half; v < mesh.positions.size(); ++v)
    mesh.positions[v].z -= mesh.positions[v].x < 60.0F ? 5.0F : 0.0F;
  const auto built = support::builtHierarchy(mesh, {});
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_FALSE(built->summary.repairs.counts.contains("flipped_triangles"));
}

TEST(Winding, leavesAConsistentMeshAsItIs) {
  Mesh mesh = sphere(60);
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) std::swap(mesh.indices[i], mesh.indices[i + 1]);
  const auto built = support::builtHierarchy(mesh, {});
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_FALSE(built->summary.repairs.counts.contains("flipped_triangles"));
  EXPECT_GT(facingInward(*built), mesh.indices.size() / 3 - 1000);
}

TEST(Winding, countsAMoebiusStripAndLeavesIt) {
  Mesh mesh;
  constexpr int kSteps = 60;
  for (int i = 0; i < kSteps; ++i) {
    const double a = 6.28318530717959 * i / kSteps;
    for (const double s : {-0.3, 0.3})
      mesh.positions.emplace_back(glm::dvec3((1.0 + s * std::cos(a / 2)) * std::cos(a),
                                             (1.0 + s * std::cos(a / 2)) * std::sin(a), s * std::sin(a / 2)));
  }
  for (std::uint32_t i = 0; i < kSteps; ++i) {
    const std::uint32_t a = 2 * i, b = 2 * i + 1;
    const bool last = i + 1 == kSteps;
    const std::uint32_t c = last ? 1 : a + 2, d = last ? 0 : b + 2;
    mesh.indices.insert(mesh.indices.end(), {a, b, c, b, d, c});
  }
  const auto built = support::builtHierarchy(mesh, {});
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_EQ(built->summary.repairs.counts.at("non_orientable_parts"), 1U);
  EXPECT_EQ(built->summary.triangles, 2U * kSteps);
}

}  // namespace
