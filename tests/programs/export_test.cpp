// `lumigrid export` writes scenes for other programs, which the project's own reader understands.
#include <sys/mount.h>

#include <cerrno>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>

#include "tests/programs/run_program.h"
#include "tests/support/mesh_reader.h"

namespace {

using nlohmann::json;
using programs::expectOneLineError;
using programs::Outcome;
using programs::readText;
using programs::run;

/// Vertices as they were read, without merging any.
support::WholeMesh readBack(const std::string& path) {
  support::WholeMesh whole;
  const auto read = mesh::streamMesh(path, whole, {});
  EXPECT_TRUE(read) << read.error().message;
  whole.finish();
  return whole;
}

class Export : public programs::ProgramTest {
 protected:
  void SetUp() override {
    programs::ProgramTest::SetUp();
    scene_ = path("scene");
  }
  void build(const std::vector<std::string>& sample) {
    std::vector<std::string> command{"sample"};
    command.insert(command.end(), sample.begin(), sample.end());
    const Outcome made = run("lumigrid", command);
    ASSERT_EQ(made.status, 0) << made.err;
    const Outcome built = run("lumigrid", {"build", sample.back(), "-o", scene_, "--methods", "patch", "--quiet"});
    ASSERT_EQ(built.status, 0) << built.err;
  }
  void buildRelief() {
    build({"--shape", "relief", "--triangles", "30000", "--origin", "500000.25", "4000000.5", "100", "-o",
           path("mesh.ply")});
  }
  json exported(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"export", scene_, "--json"});
    const Outcome outcome = run("lumigrid", arguments);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return json::parse(outcome.out);
  }
  /// The paths of all tiles that draw leaves.
  std::vector<std::string> leafTiles() {
    std::vector<std::string> paths;
    collectLeaves(json::parse(readText(path("tiles/tileset.json")))["root"], paths);
    return paths;
  }
  void collectLeaves(const json& tile, std::vector<std::string>& paths) {
    for (const json& child : tile.value("children", json::array())) collectLeaves(child, paths);
    if (!tile.contains("children") && tile.contains("content"))
      paths.push_back(path("tiles/" + tile["content"]["uri"].get<std::string>()));
  }
  std::string scene_;
};

// Positions round the mesh's and colours are within one level of what the scene holds, which is what PLY has.
TEST_F(Export, leavesOfAReliefAsTilesAreThoseAsPly) {
  buildRelief();
  const json ply = exported({"--ply", path("leaves.ply")});
  const json tiles = exported({"--3dtiles", path("tiles")});
  const json document = json::parse(readText(path("tiles/tileset.json")));
  const auto m = document["root"]["transform"].get<std::vector<double>>();
  const glm::dvec3 origin(m[12], m[13], m[14]);
  const auto leaves = readBack(path("leaves.ply"));
  EXPECT_EQ(leaves.indices.size() / 3, ply["meshes"][0]["triangles"]);

  const auto less = [](const glm::dvec3& a, const glm::dvec3& b) {
    return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
  };
  // Lattice points are farther apart than this, so that each place has one number.
  const double grain = 2e-6;
  const auto rounded = [&](const glm::dvec3& p) { return glm::round(p / grain); };
  std::map<glm::dvec3, glm::u8vec4, decltype(less)> colors(less);
  for (std::size_t v = 0; v < leaves.positions.size(); ++v)
    colors[rounded(leaves.positions[v] - origin)] = leaves.colors[v];
  std::size_t triangles = 0, near = 0, all = 0;
  for (const std::string& tile : leafTiles()) {
    const auto mesh = readBack(tile);
    triangles += mesh.indices.size() / 3;
    ASSERT_EQ(mesh.colors.size(), mesh.positions.size());
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
      const glm::dvec3 p = mesh.positions[v];
      ++all;
      const glm::dvec3 center = rounded({p.x, -p.z, p.y});
      for (int i = 0; i < 27; ++i) {
        const auto found = colors.find(center + glm::dvec3(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
        if (found == colors.end()) continue;
        ++near;
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(mesh.colors[v][c], found->second[c], 1);
        break;
      }
    }
  }
  EXPECT_EQ(near, all);
  EXPECT_EQ(triangles, leaves.indices.size() / 3);
  EXPECT_GT(tiles["3dtiles"]["triangles"].get<std::size_t>(), triangles);
}

TEST_F(Export, facadesHaveTheirPicturesAtTheLeaves) {
  build({"--shape", "facade", "--triangles", "2000", "--texels", "100", "-o", path("mesh.obj")});
  const json report = exported({"--glb", path("leaves.glb"), "--3dtiles", path("tiles")});
  const auto source = readBack(path("mesh.obj"));
  const auto glb = readBack(path("leaves.glb"));
  EXPECT_EQ(glb.indices.size(), source.indices.size());
  EXPECT_NE(readText(path("leaves.glb")).find("image/jpeg"), std::string::npos);
  std::size_t triangles = 0;
  for (const std::string& tile : leafTiles()) {
    EXPECT_NE(readText(tile).find("image/jpeg"), std::string::npos) << tile;
    triangles += readBack(tile).indices.size() / 3;
  }
  EXPECT_EQ(3 * triangles, source.indices.size());
  EXPECT_EQ(report["meshes"][0]["error"], 0.0);
}

TEST_F(Export, facadesAboveTheLeavesHaveColorsOfVertices) {
  build({"--shape", "facade", "--triangles", "20000", "--texels", "20", "-o", path("mesh.obj")});
  exported({"--3dtiles", path("tiles"), "--glb", path("coarse.glb"), "--triangles", "9k"});
  for (const std::string& coarse : {path("coarse.glb"), path("tiles/0/0.glb")}) {
    EXPECT_EQ(readText(coarse).find("image/jpeg"), std::string::npos) << coarse;
    EXPECT_NE(readText(coarse).find("COLOR_0"), std::string::npos) << coarse;
  }
  for (const std::string& tile : leafTiles()) {
    EXPECT_NE(readText(tile).find("TEXCOORD_0"), std::string::npos) << tile;
    EXPECT_EQ(readText(tile).find("COLOR_0"), std::string::npos) << tile;
  }
}

TEST_F(Export, plyOfAFewTrianglesIsBuiltAgainWithoutNewBorders) {
  buildRelief();
  const json report = exported({"--ply", path("few.ply"), "--triangles", "5k"});
  EXPECT_LE(report["meshes"][0]["triangles"], 5000);
  EXPECT_GT(report["meshes"][0]["error"], 0.0);
  const Outcome built =
      run("lumigrid", {"build", path("few.ply"), "-o", path("again"), "--methods", "patch", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  const json again = json::parse(readText(path("again/scene.json")));
  const json before = json::parse(readText(path("scene/scene.json")));
  EXPECT_EQ(again["triangles"], report["meshes"][0]["triangles"]);
  EXPECT_LE(again["source_open_edges"], before["source_open_edges"]);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(again["box_min"][k].get<double>(), before["box_min"][k].get<double>(), 0.01);
}

TEST_F(Export, refusesWhatItCannotDoInOneLine) {
  buildRelief();
  expectOneLineError(run("lumigrid", {"export", scene_}), 2, {"--3dtiles", "--ply", "--glb"});
  expectOneLineError(run("lumigrid", {"export", scene_, "--3dtiles", path("t"), "--triangles", "9"}), 2,
                     {"--triangles", "--ply"});
  expectOneLineError(run("lumigrid", {"export", path("none"), "--ply", path("a.ply")}), 1, {"none"});
  expectOneLineError(run("lumigrid", {"export", scene_, "--ply", path("a.ply"), "--triangles", "2"}), 1,
                     {"--triangles", "coarsest"});
  expectOneLineError(run("lumigrid", {"export", scene_, "--ply", path("mesh.ply")}), 1,
                     {"mesh.ply", "exists already", "--force"});
  expectOneLineError(run("lumigrid", {"export", scene_, "--3dtiles", scene_}), 1, {"scene", "not empty", "--force"});
}

TEST_F(Export, aFullDiskIsNamedAndLeavesNoDocument) {
  buildRelief();
  std::filesystem::create_directories(path("disk"));
  if (::mount("none", path("disk").c_str(), "tmpfs", 0, "size=256k") != 0)
    GTEST_SKIP() << "cannot mount a small file system here: " << std::strerror(errno);
  for (const char* option : {"--ply", "--3dtiles"})
    expectOneLineError(run("lumigrid", {"export", scene_, option, path("disk/out"), "--quiet"}), 1,
                       {"disk/out", "space"});
  EXPECT_FALSE(std::filesystem::exists(path("disk/out/tileset.json")));
  ASSERT_EQ(::mount("none", path("disk").c_str(), "tmpfs", MS_REMOUNT, "size=64m"), 0) << std::strerror(errno);
  const Outcome again = run("lumigrid", {"export", scene_, "--3dtiles", path("disk/out"), "--force", "--quiet"});
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_TRUE(std::filesystem::exists(path("disk/out/tileset.json")));
  ::umount2(path("disk").c_str(), MNT_DETACH);
}

}  // namespace
