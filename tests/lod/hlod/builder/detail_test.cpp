// Small triangles become points that cover them, and fine attributes are smoothed.
#include "lod/hlod/builder/detail.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "lod/hlod/builder/sheets.h"
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

// Whoever looks for a place of a point that stands for many finds it as near as is stated.
TEST(HlodDetail, pointsAreAsNearAsStated) {
  NodeMesh mesh = support::nodeMesh(support::openGrid(60, 0.1F), 6000.0F);
  mesh.error = 20.0F;
  mesh.points.push_back({{10.0F, 20.0F, 9000.0F}, {0.0F, 0.0F, 1.0F}, glm::vec3(9.0F)});
  mesh.points_error = 3.0F;
  const Picture picture = makePicture(mesh, 0, {200.0F, 120.0F});
  EXPECT_TRUE(picture.triangles.empty());
  float farthest = 0.0F;
  for (const glm::vec3& place : mesh.positions) {
    float least = 1e30F;
    for (const NodeVertex& point : picture.points)
      least = std::min(least, glm::distance(place, glm::vec3(point.place)));
    farthest = std::max(farthest, least);
  }
  EXPECT_LE(farthest + mesh.error, picture.points_error + 1.0F);
  EXPECT_LE(picture.points_error, mesh.error + 0.5F * 1.7320508F * 120.0F + 1.0F);
  EXPECT_TRUE(std::any_of(picture.points.begin(), picture.points.end(),
                          [](const NodeVertex& point) { return point.place == glm::ivec3(10, 20, 9000); }));
}

TEST(HlodDetail, trianglesThatAreFarOffAlreadyStayTriangles) {
  NodeMesh mesh = support::nodeMesh(support::openGrid(20, 0.1F), 2000.0F);
  mesh.error = 80.0F;
  mesh.errors.assign(mesh.triangles(), 10.0F);
  mesh.errors[7] = 80.0F;
  PictureOptions options{200.0F, 120.0F};
  options.room = 50.0F;
  const Picture picture = makePicture(mesh, 0, options);
  EXPECT_EQ(picture.triangles.size(), 3U);
  EXPECT_LT(picture.points_error, 120.0F);
}

/// A triangle with two corners near its first, all on the source's border.
void addTriangle(NodeMesh& mesh, const glm::vec3& at, float size, std::uint8_t on_rim = 1) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), {at, at + glm::vec3(size, 0, 0), at + glm::vec3(0, size, 0)});
  mesh.normals.insert(mesh.normals.end(), 3, glm::vec3(0.0F, 0.0F, 1.0F));
  mesh.on_rim.insert(mesh.on_rim.end(), 3, on_rim);
  mesh.indices.insert(mesh.indices.end(), {first, first + 1, first + 2});
}

TEST(HlodDetail, smallSheetsBecomePointsForGood) {
  NodeMesh mesh;
  addTriangle(mesh, {0, 0, 0}, 10.0F);       // small
  addTriangle(mesh, {100, 0, 0}, 50.0F);     // large
  addTriangle(mesh, {200, 0, 0}, 10.0F, 0);  // goes on in the next cell
  addTriangle(mesh, {300, 0, 0}, 10.0F);     // three at one edge
  for (int i = 0; i < 2; ++i) {
    mesh.positions.push_back(mesh.positions[9] + glm::vec3(5.0F, 0.0F, i == 0 ? 8.0F : -8.0F));
    mesh.normals.emplace_back(0.0F, 0.0F, 1.0F), mesh.on_rim.push_back(1);
    mesh.indices.insert(mesh.indices.end(), {9, 10, static_cast<std::uint32_t>(mesh.positions.size() - 1)});
  }
  mesh.error = 2.0F;
  mesh.errors.assign(mesh.triangles(), 1.0F);
  mesh.errors[3] = 2.0F;
  mesh.bounds.toward.assign(mesh.triangles(), 3.0F), mesh.bounds.from.assign(mesh.triangles(), 4.0F);
  NodeMesh strict = mesh;
  replaceSmallSheets(mesh, 20.0F, 5.0F);
  ASSERT_EQ(mesh.triangles(), 2U);
  EXPECT_EQ(mesh.positions.size(), 6U);
  EXPECT_EQ(mesh.positions[mesh.indices[0]].x, 100.0F);
  EXPECT_EQ(mesh.positions[mesh.indices[3]].x, 200.0F);
  EXPECT_EQ(mesh.points.size(), 4U * 6U);
  EXPECT_EQ(mesh.points_error, 2.0F);
  EXPECT_EQ(mesh.points_bound, 4.0F);
  EXPECT_EQ(mesh.bounds.toward.size(), 2U);
  // A work file keeps them.
  const auto back = readMesh(meshBytes(mesh));
  ASSERT_TRUE(back);
  EXPECT_EQ(back->points.size(), mesh.points.size());
  EXPECT_EQ(back->points[5].position, mesh.points[5].position);
  EXPECT_EQ(back->points_error, 2.0F);
  EXPECT_EQ(back->points_bound, 4.0F);
  // A triangle that is off by more than there is room for stays, and so do those that are too large.
  replaceSmallSheets(strict, 20.0F, 1.5F);
  EXPECT_EQ(strict.triangles(), 3U);

  addFacets(mesh, 3.0F);
  EXPECT_EQ(mesh.triangles(), 2U + mesh.points.size());
  for (std::size_t i = 6; i < mesh.indices.size(); ++i) {
    const MeshPoint& point = mesh.points[i / 3 - 2];
    EXPECT_NEAR(glm::distance(mesh.positions[mesh.indices[i]], point.position), 3.0F, 1e-4F);
  }
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
  // The lattice's last points round up, too.
  mesh.corner = glm::ivec3(kLatticeEnd - 401);
  EXPECT_EQ(makePicture(mesh, 3, {}).vertices[1].place.x, kLatticeEnd / 8);
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
  EXPECT_EQ(smoothDetail(coarse, 90.0F, {}), 0.0F);  // below the length of an edge
  EXPECT_EQ(coarse.colors, mesh.colors);
  NodeMesh plain = mesh;
  // Only what counts, and changes so that it can be seen, is moved: the normals are all the same.
  EXPECT_EQ(smoothDetail(plain, 200.0F, {.colors = false}), 0.0F);
  plain.colors.assign(plain.colors.size(), glm::vec3(90.0F));
  EXPECT_EQ(smoothDetail(plain, 200.0F, {}), 0.0F);
  // The diagonals of the grid's squares are its longest edges.
  EXPECT_NEAR(smoothDetail(mesh, 200.0F, {}), 0.5F * 1.41421F * 100.0F, 3.0F);
  for (const glm::vec3& color : mesh.colors) {
    EXPECT_GT(color.r, 40.0F);
    EXPECT_LT(color.r, 215.0F);
  }
}

}  // namespace
