// A written tileset, read and walked as a viewer does.
#include "server/export/tileset.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "tests/server/export/export_testing.h"
#include "tests/support/open_mesh.h"
#include "tests/support/temporary_directory.h"

namespace {

using export_testing::exportScene;
using export_testing::readBack;
using export_testing::Surface;
using nlohmann::json;
using server::exports::TilesetOptions;
using server::exports::writeTileset;

json readJson(const std::string& path) {
  const auto bytes = base::readFile(path);
  EXPECT_TRUE(bytes) << bytes.error().message;
  return json::parse(base::textOf(*bytes));
}

/// Distance from a point to a tile's volume; boxes have sides along the axes.
double distanceTo(const json& volume, const glm::dvec3& eye) {
  const auto b = volume["box"].get<std::vector<double>>();
  const glm::dvec3 outside = glm::abs(eye - glm::dvec3(b[0], b[1], b[2])) - glm::dvec3(b[3], b[7], b[11]);
  return glm::length(glm::max(outside, glm::dvec3(0.0)));
}

bool mayHold(const json& volume, const glm::dvec3& p) {
  return distanceTo(volume, p) < 1e-4;
}

/// A viewer at `eye` that refines tiles whose error is above `tolerance` at distance 1.
class Viewer {
 public:
  Viewer(std::string directory, const glm::dvec3& eye, double tolerance)
      : directory_(std::move(directory)), eye_(eye), tolerance_(tolerance) {
    walk(readJson(directory_ + "/tileset.json")["root"]);
  }
  Surface surface;
  std::size_t tiles = 0;

 private:
  void walk(const json& tile) {
    const std::string uri = tile.contains("content") ? tile["content"]["uri"].get<std::string>() : "";
    if (uri.ends_with(".json")) {
      const json document = readJson(directory_ + "/" + uri);
      EXPECT_EQ(document["root"]["geometricError"], tile["geometricError"]);
      EXPECT_EQ(document["root"]["boundingVolume"], tile["boundingVolume"]);
      EXPECT_EQ(document["root"]["refine"], "REPLACE");
      return walk(document["root"]);
    }
    const double distance = std::max(distanceTo(tile["boundingVolume"], eye_), 1e-7);
    if (tile.contains("children") && tile["geometricError"].get<double>() > tolerance_ * distance) {
      for (const json& child : tile["children"]) {
        EXPECT_LE(child["geometricError"].get<double>(), tile["geometricError"].get<double>());
        walk(child);
      }
      return;
    }
    if (uri.empty()) return;
    ++tiles;
    const auto mesh = readBack(directory_ + "/" + uri);
    surface.add(mesh, true);
    for (const glm::dvec3& p : mesh.positions)
      ASSERT_TRUE(mayHold(tile["boundingVolume"], export_testing::sceneFromGltf(p))) << uri;
  }

  std::string directory_;
  glm::dvec3 eye_;
  double tolerance_;
};

class Tileset : public testing::Test {
 protected:
  std::string tiles() const { return directory_ / "tiles"; }
  std::string patches() const { return directory_ / "patch.lgp"; }
  support::TemporaryDirectory directory_;
};

TEST_F(Tileset, showsAClosedSurfaceOnceAtAnyErrorFromAnywhere) {
  const support::Mesh torus = support::torus(120, 60);
  const auto scene = exportScene(torus, patches());
  ASSERT_TRUE(writeTileset(scene, tiles(), {}, nullptr));
  const double area = support::areaOf(torus);
  std::size_t different = 0, before = 0;
  for (const glm::dvec3& eye : {glm::dvec3(1.0, 0.0, 0.5), glm::dvec3(0.0, 3.0, 0.0), glm::dvec3(100.0, 0.0, 0.0)})
    for (const double tolerance : {0.5, 0.1, 0.03, 0.01, 0.003, 0.001, 1e-9}) {
      const Viewer viewer(tiles(), eye, tolerance);
      EXPECT_EQ(viewer.surface.faults(), 0U) << tolerance;
      EXPECT_NEAR(viewer.surface.area, area, 0.03 * area) << tolerance;
      different += viewer.surface.triangles != before ? 1 : 0;
      before = viewer.surface.triangles;
    }
  EXPECT_GT(different, 8U);
}

TEST_F(Tileset, leavesAreTheSource) {
  const support::Mesh torus = support::torus(60, 40);
  const auto scene = exportScene(torus, patches());
  const auto report = writeTileset(scene, tiles(), {}, nullptr);
  ASSERT_TRUE(report);
  const Viewer viewer(tiles(), glm::dvec3(0.0), 0.0);
  EXPECT_EQ(viewer.surface.triangles, torus.triangleCount());
  EXPECT_NEAR(viewer.surface.area, support::areaOf(torus), 1e-3 * viewer.surface.area);
}

TEST_F(Tileset, isTheSameSurfaceInSeveralDocuments) {
  const auto scene = exportScene(support::torus(120, 60), patches());
  const auto report = writeTileset(scene, tiles(), {.tiles_per_document = 5}, nullptr);
  ASSERT_TRUE(report);
  EXPECT_GT(report->documents, 3U);
  for (const double tolerance : {0.1, 0.01, 0.0}) {
    const Viewer viewer(tiles(), glm::dvec3(1.5, 0.0, 0.0), tolerance);
    EXPECT_EQ(viewer.surface.faults(), 0U) << tolerance;
  }
}

TEST_F(Tileset, carriesSurveyCoordinatesInItsTransformAlone) {
  const glm::dvec3 moved(500123.456, 4000789.125, 2345.5);
  auto scene = exportScene(support::torus(60, 40), patches(), moved);
  scene.scene.crs = "EPSG:32718";
  ASSERT_TRUE(writeTileset(scene, tiles(), {}, nullptr));
  const json document = readJson(tiles() + "/tileset.json");
  const auto m = document["root"]["transform"].get<std::vector<double>>();
  const glm::dvec3 origin(m[12], m[13], m[14]);
  EXPECT_EQ(origin, scene.scene.origin);
  EXPECT_EQ(document["extras"]["crs"], "EPSG:32718");

  const auto mesh = readBack(tiles() + "/" + document["root"]["content"]["uri"].get<std::string>());
  base::Aabb box;
  for (const glm::dvec3& p : mesh.positions) box.add(glm::vec3(export_testing::sceneFromGltf(p) + origin - moved));
  EXPECT_NEAR(box.max.x, 1.35F, 0.1F);
  EXPECT_NEAR(box.min.z, -0.35F, 0.1F);
}

TEST_F(Tileset, ofASceneInFeetIsInMetres) {
  auto scene = exportScene(support::torus(60, 40), patches());
  scene.scene.units = "ft";
  ASSERT_TRUE(writeTileset(scene, tiles(), {}, nullptr));
  EXPECT_EQ(readJson(tiles() + "/tileset.json")["root"]["transform"][5], 0.3048);
}

TEST_F(Tileset, unlitTilesHaveColorsAndNoNormalsLitOnesTheContrary) {
  const auto scene = exportScene(support::torus(60, 40), patches());
  ASSERT_TRUE(writeTileset(scene, tiles(), {}, nullptr));
  const auto unlit = readBack(tiles() + "/0/0.glb");
  EXPECT_FALSE(unlit.colors.empty());
  EXPECT_TRUE(unlit.normals.empty());
  support::Mesh grey = support::torus(60, 40);
  grey.colors.clear();
  const auto lit_scene = exportScene(grey, directory_ / "grey.lgp");
  ASSERT_TRUE(writeTileset(lit_scene, directory_ / "lit", {}, nullptr));
  const auto lit = readBack(directory_ / "lit/0/0.glb");
  EXPECT_TRUE(lit.colors.empty());
  EXPECT_FALSE(lit.normals.empty());
}

TEST_F(Tileset, isNotWrittenOverOtherFiles) {
  const auto scene = exportScene(support::torus(30, 20), patches());
  const auto refused = writeTileset(scene, directory_.path(), {}, nullptr);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, base::ErrorCode::kExists);
  EXPECT_NE(refused.error().message.find("--force"), std::string::npos);
}

TEST_F(Tileset, replacesAnEarlierOneAndLeavesOtherFiles) {
  const auto scene = exportScene(support::torus(60, 40), patches());
  ASSERT_TRUE(base::makeDirectories(tiles() + "/77"));
  ASSERT_TRUE(base::makeDirectories(tiles() + "/kept"));
  for (const char* name : {"/77/77001.glb", "/tileset-9.json", "/tileset.json", "/notes.txt", "/kept/7.glb"})
    ASSERT_TRUE(base::writeFileAtomically(tiles() + name, base::viewOfText("old")));
  ASSERT_TRUE(writeTileset(scene, tiles(), {.force = true}, nullptr));
  EXPECT_FALSE(std::filesystem::exists(tiles() + "/77/77001.glb"));
  EXPECT_FALSE(std::filesystem::exists(tiles() + "/tileset-9.json"));
  EXPECT_TRUE(std::filesystem::exists(tiles() + "/notes.txt"));
  EXPECT_TRUE(std::filesystem::exists(tiles() + "/kept/7.glb"));
  EXPECT_TRUE(readJson(tiles() + "/tileset.json").contains("root"));
}

TEST_F(Tileset, thatIsCancelledHasNoDocument) {
  const auto scene = exportScene(support::torus(60, 40), patches());
  const auto cancelled = writeTileset(scene, tiles(), {}, [](double, std::uint64_t) { return false; });
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, base::ErrorCode::kCancelled);
  EXPECT_FALSE(std::filesystem::exists(tiles() + "/tileset.json"));
}

}  // namespace
