// Small triangles become points that cover them, and fine attributes are smoothed.
#include "lod/hlod/builder/detail.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/lod/hlod/builder/node_meshes.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::hlod;
using namespace lod::hlod::builder;

TEST(HlodDetail, smallTrianglesBecomePointsThatCoverThem) {
  const NodeMesh mesh = support::nodeMesh(support::openGrid(60, 0.1F), 6000.0F);  // squares of 100 steps
  constexpr float kCell = 60.0F;
  const NodeGeometry picture = makePicture(mesh, 0, {2.0F * kCell, kCell});
  EXPECT_TRUE(picture.triangles.empty());
  EXPECT_TRUE(picture.edges.empty());
  ASSERT_FALSE(picture.points.empty());
  EXPECT_LT(picture.points.size(), 6 * mesh.triangles() / 2);
  // No place of the surface is farther from a point than a point's spacing and a cell's diagonal.
  support::SurfacePoints places(support::surfaceOf(mesh), 3);
  const support::Surface surface = support::surfaceOf(mesh);
  support::SurfacePoints samples(surface, 3);
  for (int i = 0; i < 2000; ++i) {
    const glm::dvec3 at = samples.next();
    double least = 1e30;
    for (const NodeVertex& point : picture.points) least = std::min(least, glm::distance(at, glm::dvec3(point.place)));
    EXPECT_LE(least, 1.7320508 * static_cast<double>(kCell));
  }
}

TEST(HlodDetail, largeTrianglesStayWithTheirOpenEdges) {
  const NodeMesh mesh = support::nodeMesh(support::openGrid(10, 0.0F), 1000.0F);
  const NodeGeometry picture = makePicture(mesh, 0, {10.0F, 5.0F});
  EXPECT_EQ(picture.triangles.size(), mesh.indices.size());
  EXPECT_EQ(picture.edges.size() / 2, 40U);
  NodeMesh alone = mesh;
  alone.on_rim.assign(alone.positions.size(), 1);
  EXPECT_TRUE(makePicture(alone, 0, {10.0F, 5.0F}).edges.empty());
  EXPECT_TRUE(picture.points.empty());
}

TEST(HlodDetail, bothSidesOfAThinWallRemain) {
  NodeMesh wall;
  for (const float z : {0.0F, 1.0F}) {
    const auto first = static_cast<std::uint32_t>(wall.positions.size());
    wall.positions.insert(wall.positions.end(), {{100, 100, z}, {104, 100, z}, {100, 104, z}});
    wall.on_rim.insert(wall.on_rim.end(), 3, 0);
    wall.normals.insert(wall.normals.end(), 3, glm::vec3(0.0F, 0.0F, z > 0.0F ? 1.0F : -1.0F));
    wall.indices.insert(wall.indices.end(), {first, first + 1, first + 2});
  }
  const NodeGeometry picture = makePicture(wall, 0, {50.0F, 20.0F});
  std::set<float> sides;
  for (const NodeVertex& point : picture.points) sides.insert(point.normal.z);
  EXPECT_EQ(sides, (std::set<float>{-1.0F, 1.0F}));
}

TEST(HlodDetail, stepsOfAPowerOfTwoRoundPlaces) {
  NodeMesh mesh;
  mesh.corner = {1000, 2000, 3000};
  mesh.positions = {{0, 0, 0}, {400, 0, 0}, {0, 400, 7}};
  mesh.normals.assign(3, glm::vec3(0.0F, 0.0F, 1.0F));
  mesh.on_rim.assign(3, 0);
  mesh.indices = {0, 1, 2};
  const NodeGeometry picture = makePicture(mesh, 3, {});
  ASSERT_EQ(picture.vertices.size(), 3U);
  EXPECT_EQ(picture.vertices[0].place, glm::ivec3(125, 250, 375));
  EXPECT_EQ(picture.vertices[1].place, glm::ivec3(175, 250, 375));
  EXPECT_EQ(picture.vertices[2].place, glm::ivec3(125, 300, 376));
}

TEST(HlodDetail, trianglesThatRoundingFlattensAreLeftOut) {
  NodeMesh mesh;
  mesh.positions = {{0, 0, 0}, {400, 0, 0}, {0, 400, 0}, {2, 1, 0}};
  mesh.normals.assign(4, glm::vec3(0.0F, 0.0F, 1.0F));
  mesh.on_rim.assign(4, 0);
  mesh.indices = {3, 1, 2, 0, 1, 3, 0, 3, 2};
  const NodeGeometry picture = makePicture(mesh, 3, {});
  EXPECT_EQ(picture.triangles.size(), 3U);
}

TEST(HlodDetail, wiresStayWhereRoundingFlattensThem) {
  NodeMesh mesh;
  mesh.positions = {{0, 0, 0}, {800, 1, 0}, {800, 0, 1}};
  mesh.normals.assign(3, glm::vec3(0.0F, 0.0F, 1.0F));
  mesh.on_rim.assign(3, 1);
  mesh.indices = {0, 1, 2};
  const NodeGeometry picture = makePicture(mesh, 3, {});
  ASSERT_EQ(picture.triangles.size(), 3U);
  std::set<int> along;
  for (const std::uint32_t v : picture.triangles) along.insert(picture.vertices[v].place.x);
  EXPECT_EQ(*along.begin(), 0);
  EXPECT_EQ(*along.rbegin(), 100);
}

TEST(HlodDetail, onlyWhatIsFineIsSmoothed) {
  NodeMesh mesh = support::nodeMesh(support::openGrid(40, 0.0F), 4000.0F);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    mesh.colors.push_back(glm::vec3((v % 2) != 0 ? 255.0F : 0.0F));
  NodeMesh coarse = mesh;
  smoothDetail(coarse, 90.0F);  // below the length of an edge
  EXPECT_EQ(coarse.colors, mesh.colors);
  smoothDetail(mesh, 200.0F);
  for (const glm::vec3& color : mesh.colors) {
    EXPECT_GT(color.r, 40.0F);
    EXPECT_LT(color.r, 215.0F);
  }
}

}  // namespace
