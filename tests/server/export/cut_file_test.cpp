// One cut as a file, read back by the project's own reader.
#include "server/export/cut_file.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "tests/server/export/export_testing.h"
#include "tests/support/temporary_directory.h"

namespace {

using export_testing::exportScene;
using export_testing::readBack;
using export_testing::Surface;
using server::exports::kAllTriangles;
using server::exports::selectCutForExport;
using server::exports::writeCutAsGlb;
using server::exports::writeCutAsPly;

class CutFile : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return directory_ / name; }
  support::TemporaryDirectory directory_;
};

TEST_F(CutFile, cutsHaveAtMostTheTrianglesAskedForAndUseMostOfThem) {
  const auto scene = exportScene(support::torus(120, 60), path("patch.lgp"));
  float before = 1e9F;
  for (const std::uint64_t most : {1000ULL, 3000ULL, 8000ULL, 14000ULL}) {
    const auto cut = selectCutForExport(scene.hierarchy(), most);
    ASSERT_TRUE(cut) << cut.error().message;
    EXPECT_LE(cut->cut.triangles, most);
    EXPECT_GT(cut->cut.triangles, most / 2);
    EXPECT_LT(cut->error, before);
    before = cut->error;
  }
  const auto leaves = selectCutForExport(scene.hierarchy(), kAllTriangles);
  EXPECT_EQ(leaves->cut.triangles, scene.hierarchy().source_triangles);
  EXPECT_EQ(leaves->error, 0.0F);
}

TEST_F(CutFile, fewerTrianglesThanTheCoarsestCutHasAreRefused) {
  const auto scene = exportScene(support::torus(60, 40), path("patch.lgp"));
  const auto cut = selectCutForExport(scene.hierarchy(), 3);
  ASSERT_FALSE(cut);
  EXPECT_NE(cut.error().message.find("--triangles"), std::string::npos);
}

TEST_F(CutFile, plyIsClosedByItsIndicesAtEveryCut) {
  const auto scene = exportScene(support::torus(120, 60), path("patch.lgp"));
  for (const std::uint64_t most : {1000ULL, 5000ULL, 14400ULL}) {
    const auto cut = selectCutForExport(scene.hierarchy(), most);
    const auto report = writeCutAsPly(scene, cut->cut, path("a.ply"), nullptr);
    ASSERT_TRUE(report) << report.error().message;
    EXPECT_EQ(report->bytes, std::filesystem::file_size(path("a.ply")));
    const auto mesh = readBack(path("a.ply"));
    EXPECT_EQ(mesh.positions.size(), report->vertices);
    EXPECT_EQ(mesh.colors.size(), report->vertices);
    EXPECT_EQ(mesh.indices.size(), 3 * cut->cut.triangles);
    // A closed surface of genus 1 has half as many vertices as triangles.
    EXPECT_EQ(2 * report->vertices, report->triangles);
    Surface surface;
    surface.add(mesh, false);
    EXPECT_EQ(surface.faults(), 0U);
  }
}

TEST_F(CutFile, plyHasSurveyCoordinatesToTheLattice) {
  const glm::dvec3 moved(500123.456, 4000789.125, 2345.5);
  const support::Mesh torus = support::torus(60, 40);
  const auto scene = exportScene(torus, path("patch.lgp"), moved);
  const auto cut = selectCutForExport(scene.hierarchy(), kAllTriangles);
  ASSERT_TRUE(writeCutAsPly(scene, cut->cut, path("a.ply"), nullptr));
  const auto mesh = readBack(path("a.ply"));
  ASSERT_EQ(mesh.positions.size(), torus.positions.size());
  const double off = 1.01 * scene.hierarchy().lattice.positionError();
  for (const glm::vec3& p : torus.positions) {
    const glm::dvec3 at = moved + glm::dvec3(p);
    EXPECT_TRUE(std::any_of(mesh.positions.begin(), mesh.positions.end(),
                            [&](const glm::dvec3& q) { return glm::distance(at, q) <= off; }));
  }
}

TEST_F(CutFile, plyOfALitSceneHasNormalsAndNoColors) {
  support::Mesh grey = support::torus(60, 40);
  grey.colors.clear();
  const auto scene = exportScene(grey, path("patch.lgp"));
  const auto cut = selectCutForExport(scene.hierarchy(), kAllTriangles);
  ASSERT_TRUE(writeCutAsPly(scene, cut->cut, path("a.ply"), nullptr));
  const auto mesh = readBack(path("a.ply"));
  EXPECT_TRUE(mesh.colors.empty());
  ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
  for (std::size_t v = 0; v < mesh.normals.size(); v += 17) EXPECT_NEAR(glm::length(mesh.normals[v]), 1.0F, 1e-5F);
}

TEST_F(CutFile, glbHasTheScenesUpAsY) {
  auto scene = exportScene(support::torus(60, 40), path("patch.lgp"));  // flat along z
  const auto cut = selectCutForExport(scene.hierarchy(), kAllTriangles);
  const std::array<std::pair<glm::dvec3, int>, 6> rows{
      {{{0, 0, 1}, 1}, {{0, 0, -1}, 1}, {{0, 1, 0}, 2}, {{0, -1, 0}, 2}, {{1, 0, 0}, 2}, {{-1, 0, 0}, 2}}};
  for (const auto& [up, flat] : rows) {
    scene.scene.up = up;
    ASSERT_TRUE(writeCutAsGlb(scene, cut->cut, path("a.glb"), nullptr));
    const auto mesh = readBack(path("a.glb"));
    base::Aabb box;
    for (const glm::dvec3& p : mesh.positions) box.add(glm::vec3(p));
    for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(box.size()[axis] < 1.0F, axis == flat) << up.x << up.y << up.z;
    Surface surface;
    surface.add(mesh, true);
    EXPECT_EQ(surface.faults(), 0U);
  }
}

TEST_F(CutFile, cancelledFilesAreNotThere) {
  const auto scene = exportScene(support::torus(60, 40), path("patch.lgp"));
  const auto cut = selectCutForExport(scene.hierarchy(), kAllTriangles);
  const auto stop = [](double) { return false; };
  EXPECT_EQ(writeCutAsPly(scene, cut->cut, path("a.ply"), stop).error().code, base::ErrorCode::kCancelled);
  EXPECT_EQ(writeCutAsGlb(scene, cut->cut, path("a.glb"), stop).error().code, base::ErrorCode::kCancelled);
  EXPECT_FALSE(std::filesystem::exists(path("a.ply")));
  EXPECT_FALSE(std::filesystem::exists(path("a.glb")));
}

}  // namespace
