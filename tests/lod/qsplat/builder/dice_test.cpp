// Sub-triangles of diced triangles are small and cover them, triangles that meet share points, and the leaves leave no
// hole and are not too many.
#include "lod/qsplat/builder/dice.h"

#include <gtest/gtest.h>

#include <map>
#include <random>

#include "tests/lod/qsplat/builder/splat_leaves.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::qsplat::builder;
using support::Mesh;

glm::dvec3 areaOf(const Dicer& dicer, const std::array<std::uint32_t, 3>& t) {
  const glm::dvec3 a = dicer.position(t[0]);
  return glm::cross(dicer.position(t[1]) - a, dicer.position(t[2]) - a);
}

TEST(Dicer, subTrianglesAreSmallAndCoverTheTriangle) {
  std::minstd_rand random(11);
  const auto place = [&] { return glm::ivec3(random() % 4000, random() % 4000, random() % 4000); };
  for (int run = 0; run < 50; ++run) {
    const std::vector<glm::ivec3> points{place(), place(), place()};
    if (countCuts(points, 300.0, 0)) continue;
    Dicer dicer(points, 300.0);
    dicer.cut({0, 1, 2}, 7);
    const glm::dvec3 whole = areaOf(dicer, {0, 1, 2});
    glm::dvec3 sum(0.0);
    for (const Dicer::SubTriangle& piece : dicer.subTriangles()) {
      EXPECT_EQ(piece.triangle, 7U);
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_LE(glm::distance(dicer.position(piece.corners[k]), dicer.position(piece.corners[(k + 1) % 3])), 300.0);
      const glm::dvec3 area = areaOf(dicer, piece.corners);
      EXPECT_GT(glm::dot(area, whole), 0.0);
      sum += area;
    }
    EXPECT_LT(glm::distance(sum, whole), 1e-9 * glm::length(whole));
  }
}

TEST(Dicer, trianglesShareThePointsOfTheirEdge) {
  // A fan of needles around a long edge, given from either end.
  const std::vector<glm::ivec3> points{{0, 0, 0}, {5000, 300, 77}, {2500, 900, 0}, {2400, -30, 0}, {100, 0, 2000}};
  Dicer dicer(points, 400.0);
  dicer.cut({0, 1, 2}, 0);
  dicer.cut({1, 0, 3}, 1);
  dicer.cut({1, 4, 0}, 2);
  // Every edge of a sub-triangle is shared by another one, or lies on the outline.
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const Dicer::SubTriangle& piece : dicer.subTriangles())
    for (std::size_t k = 0; k < 3; ++k) ++uses[std::minmax(piece.corners[k], piece.corners[(k + 1) % 3])];
  const auto onEdge = [&](std::uint32_t p) {
    const glm::dvec3 along = glm::normalize(glm::dvec3(points[1]));
    return glm::length(glm::cross(dicer.position(p), along)) < 1e-9;
  };
  int shared = 0;
  for (const auto& [edge, count] : uses) {
    EXPECT_LE(count, 3);
    if (!onEdge(edge.first) || !onEdge(edge.second)) continue;
    EXPECT_EQ(count, 3);
    ++shared;
  }
  EXPECT_EQ(shared, 16);  // the edge of 5009.6 halved four times
}

TEST(Dicer, countCutsCountsTheCutsOfDicing) {
  const std::vector<glm::ivec3> points{{0, 0, 0}, {3000, 10, 5}, {40, 1700, 900}};
  Dicer dicer(points, 200.0);
  dicer.cut({0, 1, 2}, 0);
  const std::uint64_t cuts = dicer.subTriangles().size() - 1;
  EXPECT_EQ(countCuts(points, 200.0, cuts), cuts);
  EXPECT_FALSE(countCuts(points, 200.0, cuts - 1));
  EXPECT_EQ(countCuts(points, 5000.0, 0), 0U);
}

TEST(Dicer, trianglesUpToTheLimitAreNotCut) {
  const std::vector<glm::ivec3> triangle{glm::ivec3(0), {30, 0, 0}, {0, 40, 0}};
  EXPECT_TRUE(countCuts(triangle, 50.0, 0));
  EXPECT_FALSE(countCuts(triangle, 49.9, 0));
}

// A sheet whose columns get wider and wider, so that its triangles are needles of all lengths.
Mesh stretchedSheet(std::uint32_t side) {
  Mesh mesh;
  for (std::uint32_t y = 0; y <= side; ++y)
    for (std::uint32_t x = 0; x <= side; ++x) {
      const float u = static_cast<float>(x) / static_cast<float>(side);
      mesh.positions.emplace_back(100.0F * u * u * u * u, static_cast<float>(y) * 0.1F, std::sin(12.0F * u));
    }
  for (std::uint32_t y = 0; y < side; ++y)
    for (std::uint32_t x = 0; x < side; ++x) {
      const std::uint32_t a = y * (side + 1) + x, b = a + side + 1;
      mesh.indices.insert(mesh.indices.end(), {a, a + 1, b, a + 1, b + 1, b});
    }
  return mesh;
}

// Returns the least distance of `p` from a leaf's centre, in radii of that leaf.
double leastReach(const std::vector<Splat>& leaves, const glm::dvec3& p) {
  double least = 1e30;
  for (const Splat& leaf : leaves)
    least = std::min(least, glm::distance(p, glm::dvec3(leaf.sphere.center)) / static_cast<double>(leaf.sphere.radius));
  return least;
}

void expectCovered(const support::MeshSplats& splats, int count) {
  std::minstd_rand random(5);
  const auto unit = [&] { return static_cast<double>(random() % 100'001) / 100'000.0; };
  const Mesh& mesh = splats.sorted;
  for (int i = 0; i < count; ++i) {
    const std::size_t t = random() % mesh.triangleCount();
    double a = unit(), b = unit();
    if (a + b > 1.0) a = 1.0 - a, b = 1.0 - b;
    const glm::dvec3 p = (1.0 - a - b) * glm::dvec3(mesh.positions[mesh.indices[3 * t]]) +
                         a * glm::dvec3(mesh.positions[mesh.indices[3 * t + 1]]) +
                         b * glm::dvec3(mesh.positions[mesh.indices[3 * t + 2]]);
    ASSERT_LE(leastReach(splats.leaves, p), 1.0 + 1e-6);
  }
}

TEST(DicedLeaves, coverTheSurface) {
  for (const double dice : {0.5, 2.0, 8.0}) {
    expectCovered(support::splatsOf(stretchedSheet(60), dice), 2000);
    expectCovered(support::splatsOf(support::torus(60, 30), dice), 1000);
    expectCovered(support::splatsOf(support::triangleSoup(300), dice), 1000);
  }
}

TEST(DicedLeaves, coverTheSurfaceAcrossBuckets) {
  const support::MeshSplats splats = support::splatsOf(stretchedSheet(520), 1.0);
  EXPECT_GT(splats.buckets, 1U);
  EXPECT_GT(splats.leaves.size(), std::size_t{521 * 521} + 10'000);
  expectCovered(splats, 1500);
}

TEST(DicedLeaves, areMuchSmallerThanNeedlesWouldMakeThem) {
  const auto largest = [](const support::MeshSplats& splats) {
    float radius = 0.0F;
    for (const Splat& leaf : splats.leaves) radius = std::max(radius, leaf.sphere.radius);
    return radius;
  };
  const Mesh mesh = stretchedSheet(60);
  EXPECT_LT(largest(support::splatsOf(mesh, 2.0)), 0.3F * largest(support::splatsOf(mesh)));
}

TEST(DicedLeaves, areBoundedInNumber) {
  // Without a bound a giant triangle among 400 000 small ones would be cut into hundreds of millions.
  Mesh mesh = stretchedSheet(450);
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (const glm::vec3& p : {glm::vec3(-2000, 0, 30), glm::vec3(2000, 0, 30), glm::vec3(0, 3000, 30)})
    mesh.positions.push_back(p);
  mesh.indices.insert(mesh.indices.end(), {first, first + 1, first + 2});
  const support::MeshSplats splats = support::splatsOf(mesh, 1e-3);
  EXPECT_GT(splats.leaves.size(), mesh.positions.size() * 11 / 10);
  EXPECT_LE(splats.leaves.size(), mesh.positions.size() + mesh.triangleCount() / 2);
  // Small meshes may grow to thousands of leaves.
  Mesh one;
  one.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  one.indices = {0, 1, 2};
  const std::size_t of_one = support::splatsOf(one, 1e-3).leaves.size();
  EXPECT_GT(of_one, 8'000U);
  EXPECT_LE(of_one, 3U + (1U << 14));
}

TEST(DicedLeaves, takeColorsAndNormalsFromBothEnds) {
  Mesh mesh;
  mesh.positions = {{0, 0, 0}, {64, 0, 0}, {0, 64, 0}, {64, 64, 0}};
  mesh.indices = {0, 1, 2, 1, 3, 2};
  mesh.colors = {{200, 0, 0, 255}, {0, 200, 0, 255}, {200, 0, 0, 255}, {0, 200, 0, 255}};
  const support::MeshSplats splats = support::splatsOf(mesh, 0.1);
  EXPECT_GT(splats.leaves.size(), 500U);
  double weight = 0.0;
  for (const Splat& leaf : splats.leaves) {
    const float x = (leaf.sphere.center.x + static_cast<float>(splats.sorted.origin.x)) / 64.0F;
    const glm::vec3 color = leaf.color / leaf.weight;
    EXPECT_NEAR(color.r, 200.0F * (1.0F - x), 2.0F);
    EXPECT_NEAR(color.g, 200.0F * x, 2.0F);
    EXPECT_NEAR(leaf.normal.z / leaf.weight, 1.0F, 1e-5F);
    EXPECT_GT(leaf.least_cosine, 0.99F);
    weight += static_cast<double>(leaf.weight);
  }
  // The weights sum up to three times the area, since each sub-triangle counts at its three corners.
  const double step = splats.lattice.lattice.step;
  EXPECT_NEAR(weight * step * step, 3.0 * 2.0 * 64.0 * 64.0, 60.0);
}

TEST(DicedLeaves, keepGivenNormals) {
  Mesh mesh;
  mesh.positions = {{0, 0, 0}, {64, 0, 0}, {0, 64, 0}};
  mesh.indices = {0, 1, 2};
  const glm::vec3 given = glm::normalize(glm::vec3(0.0F, 1.0F, 1.0F));
  mesh.normals = {given, given, given};
  for (const Splat& leaf : support::splatsOf(mesh, 0.1).leaves)
    EXPECT_GT(glm::dot(leaf.normal / leaf.weight, given), 0.9999F);
}

}  // namespace
