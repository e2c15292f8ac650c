// Collapses within an error: what they keep, measured by sampling.
#include "lod/hlod/builder/collapse.h"

#include <gtest/gtest.h>

#include "tests/lod/hlod/builder/node_meshes.h"
#include "tests/support/surface_distance.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::hlod::builder;

AppearanceOptions shapeAlone() {
  AppearanceOptions options;
  options.normals = options.colors = false;
  return options;
}

float largest(const std::vector<float>& values) {
  return *std::max_element(values.begin(), values.end());
}

struct Sampled {
  double toward = 0.0, from = 0.0;
};
Sampled sampledBetween(const NodeMesh& source, const NodeMesh& result) {
  const support::Surface before = support::surfaceOf(source), after = support::surfaceOf(result);
  return {support::sampledDistance(before, support::NearestSurface(after), 30000).max,
          support::sampledDistance(after, support::NearestSurface(before), 30000).max};
}

void expectWithin(const NodeMesh& source, float limit, const char* name) {
  NodeMesh result = source;
  applyCollapses(result, collapseWithin(source, limit, shapeAlone()));
  EXPECT_LT(result.triangles(), source.triangles() / 4) << name;
  EXPECT_LE(result.error, limit) << name;
  const Sampled sampled = sampledBetween(source, result);
  EXPECT_LE(sampled.toward, 1.01 * static_cast<double>(limit)) << name;
  EXPECT_LE(sampled.from, 1.01 * static_cast<double>(limit)) << name;
  // The proven bounds hold, and are mostly not far above the limit; a few triangles at open edges are nearer than can
  // be proved.
  EXPECT_LE(sampled.toward, static_cast<double>(largest(result.bounds.toward))) << name;
  EXPECT_LE(sampled.from, static_cast<double>(largest(result.bounds.from))) << name;
  EXPECT_LE(largest(result.bounds.toward), 1.5F * limit) << name;
  std::vector<float> from = result.bounds.from;
  std::sort(from.begin(), from.end());
  EXPECT_LE(from[from.size() * 9 / 10], 1.5F * limit) << name;
}

TEST(HlodCollapse, bothSurfacesStayWithinTheLimit) {
  for (const float share : {400.0F, 100.0F}) {
    expectWithin(support::nodeMesh(support::bumpySphere(120, 240), 20000.0F), 20000.0F / share, "sphere");
    expectWithin(support::nodeMesh(support::torus(240, 80), 20000.0F), 20000.0F / share, "torus");
    expectWithin(support::nodeMesh(support::openGrid(120), 20000.0F), 20000.0F / share, "open grid");
    expectWithin(support::nodeMesh(support::plant(), 20000.0F), 20000.0F / share, "plant");
  }
}

TEST(HlodCollapse, closedSurfacesStayClosed) {
  NodeMesh mesh = support::nodeMesh(support::torus(200, 80), 10000.0F);
  ASSERT_TRUE(openEdges(mesh.indices).empty());
  applyCollapses(mesh, collapseWithin(mesh, 200.0F, shapeAlone()));
  EXPECT_TRUE(openEdges(mesh.indices).empty());
}

// The outline of a hole with a concave rim: triangles may not grow across it.
TEST(HlodCollapse, bordersStayWhereTheyAre) {
  support::Mesh star;
  constexpr std::uint32_t kSides = 400;
  for (std::uint32_t i = 0; i < kSides; ++i) {
    const float turn = 6.2831853F * static_cast<float>(i) / kSides;
    const float rim = 1.0F + 0.3F * std::cos(9.0F * turn);
    star.positions.push_back(rim * glm::vec3(std::cos(turn), std::sin(turn), 0.0F));
    star.positions.push_back(2.0F * glm::vec3(std::cos(turn), std::sin(turn), 0.0F));
    const std::uint32_t a = 2 * i, b = 2 * ((i + 1) % kSides);
    support::addTriangle(star, a, a + 1, b + 1);
    support::addTriangle(star, a, b + 1, b);
  }
  expectWithin(support::nodeMesh(star, 20000.0F), 60.0F, "rim");
}

TEST(HlodCollapse, whatIsAlreadyOffCountsWhereBoundsAreCarried) {
  const NodeMesh source = support::nodeMesh(support::bumpySphere(100, 200), 20000.0F);
  constexpr float kLimit = 100.0F;
  NodeMesh once = source;
  applyCollapses(once, collapseWithin(once, 0.6F * kLimit, shapeAlone()));
  NodeMesh twice = once;
  applyCollapses(twice, collapseWithin(twice, kLimit, shapeAlone(), Carried::kBounds));
  EXPECT_LT(twice.triangles(), once.triangles());
  EXPECT_LE(largest(twice.bounds.toward), 1.5F * kLimit);
  const Sampled sampled = sampledBetween(source, twice);
  EXPECT_LE(sampled.toward, static_cast<double>(largest(twice.bounds.toward)));
  EXPECT_LE(sampled.from, static_cast<double>(largest(twice.bounds.from)));
}

// A flat sheet of two colours keeps the circle between them, and little else.
TEST(HlodCollapse, edgesOfColorStay) {
  support::Mesh sheet = support::openGrid(100, 0.0F);
  for (const glm::vec3& p : sheet.positions)
    sheet.colors.push_back(glm::length(glm::vec2(p) - 0.5F) < 0.3F ? glm::u8vec4(200, 30, 30, 255)
                                                                   : glm::u8vec4(30, 60, 200, 255));
  const NodeMesh source = support::nodeMesh(sheet, 10000.0F);
  AppearanceOptions options;
  NodeMesh result = source;
  const float limit = 150.0F;  // one and a half squares of the grid
  applyCollapses(result, collapseWithin(source, limit, options));
  EXPECT_LT(result.triangles(), source.triangles() / 8);
  NodeMesh shape = source;
  applyCollapses(shape, collapseWithin(source, limit, shapeAlone()));
  EXPECT_LT(shape.triangles(), result.triangles() / 4);
  // Each vertex of the source finds its colour within the limit.
  const auto placeOf = [](const NodeMesh& mesh, std::uint32_t v) {
    return support::SurfacePlace{mesh.positions[v], mesh.normals[v], mesh.colors[v]};
  };
  for (std::uint32_t v = 0; v < source.positions.size(); v += 7) {
    float least = 1e30F;
    for (std::size_t i = 0; i < result.indices.size(); i += 3) {
      const auto corner = [&](std::size_t k) { return placeOf(result, result.indices[i + k]); };
      least = std::min(least, support::errors2(placeOf(source, v), corner(0), corner(1), corner(2), options)[0]);
    }
    EXPECT_LE(std::sqrt(least), 1.0001F * limit) << v;
  }
}

TEST(HlodCollapse, soupAndBrokenMeshesDoNoHarm) {
  std::mt19937 random(9);
  std::uniform_int_distribution<int> place(0, 300);
  NodeMesh soup;
  for (int i = 0; i < 900; ++i) {
    soup.positions.emplace_back(place(random), place(random), place(random) / 20);
    soup.normals.emplace_back(0.0F, 0.0F, 1.0F);
    soup.on_rim.push_back(0);
  }
  std::uniform_int_distribution<std::uint32_t> vertex(0, 899);
  for (int t = 0; t < 1500; ++t) {
    const std::uint32_t a = vertex(random), b = vertex(random), c = vertex(random);
    if (a != b && b != c && a != c) soup.indices.insert(soup.indices.end(), {a, b, c});
  }
  NodeMesh result = soup;
  applyCollapses(result, collapseWithin(soup, 20.0F, shapeAlone()));
  EXPECT_GT(result.triangles(), 0U);
  const Sampled sampled = sampledBetween(soup, result);
  EXPECT_LE(sampled.toward, static_cast<double>(largest(result.bounds.toward)) + 1e-3);
}

}  // namespace
