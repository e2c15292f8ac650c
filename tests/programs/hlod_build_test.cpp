// lumigrid build --methods hlod as a user runs it, and its file in info, verify, publish and serve.
#include <nlohmann/json.hpp>

#include "base/hash/sha256.h"
#include "tests/programs/resumed_build.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::longTests;
using programs::readText;
using programs::run;

class HlodBuild : public programs::ResumedBuild {
 protected:
  HlodBuild() {
    method_ = "hlod";
    file_ = "hlod.lgh";
    options_ = {"--hlod-triangles", "2000"};
  }
};

TEST_F(HlodBuild, aMeshBecomesASceneThatIsWell) {
  const std::string mesh = sample("60000"), scene = path("scene");
  const auto built = run("lumigrid", build(mesh, scene, {"--json"}));
  ASSERT_EQ(built.status, 0) << built.err;
  const json hlod = json::parse(built.out)["hlod"];
  const json document = json::parse(readText(scene + "/scene.json"));
  EXPECT_EQ(hlod["triangles"], document["triangles"]);
  EXPECT_EQ(document["open_edges"], 0);
  EXPECT_EQ(document["parameters"]["methods"], "hlod");
  EXPECT_EQ(document["parameters"]["hlod-triangles"], "2000");
  ASSERT_EQ(document["parts"].size(), 1U);
  EXPECT_EQ(document["parts"][0]["file"], "hlod.lgh");
  EXPECT_GT(json::parse(readText(scene + "/build.json"))["hlod"]["seconds"], 0.0);

  const json& levels = hlod["levels"];
  ASSERT_GT(levels.size(), 2U);
  EXPECT_EQ(levels[0]["nodes"], 1);
  for (std::size_t depth = 0; depth + 1 < levels.size(); ++depth)
    EXPECT_GT(levels[depth]["largest_error"], levels[depth + 1]["largest_error"]) << depth;
  EXPECT_EQ(levels.back()["largest_error"], 0.0);

  const auto verified = run("lumigrid", {"verify", scene, "--quiet"});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
  const auto again = run("lumigrid", build(mesh, scene));
  EXPECT_NE(again.out.find("nothing was to be done"), std::string::npos) << again.out << again.err;
}

TEST_F(HlodBuild, infoSaysOfTheFileWhatTheBuildSaid) {
  const std::string mesh = sample("30000"), scene = path("scene");
  const auto built = run("lumigrid", build(mesh, scene, {"--json"}));
  ASSERT_EQ(built.status, 0) << built.err;
  const auto info = run("lumigrid", {"info", scene, "--json", "--digest"});
  ASSERT_EQ(info.status, 0) << info.err;
  const json said = json::parse(built.out)["hlod"], told = json::parse(info.out)["hlod"];
  EXPECT_EQ(told["sha256"].get<std::string>().size(), 64U);
  for (const char* number : {"bytes", "nodes", "triangles", "bytes_per_triangle"})
    EXPECT_EQ(told[number], said[number]) << number;
  ASSERT_EQ(told["levels"].size(), said["levels"].size());
  for (std::size_t depth = 0; depth < told["levels"].size(); ++depth) {
    for (const char* number : {"nodes", "triangles", "points", "caster_triangles", "picture_bytes", "caster_bytes"})
      EXPECT_EQ(told["levels"][depth][number], said["levels"][depth][number]) << depth << ", " << number;
    // The table rounds errors up.
    const double error = said["levels"][depth]["largest_error"];
    EXPECT_GE(told["levels"][depth]["largest_error"], error);
    EXPECT_LE(told["levels"][depth]["largest_error"], 1.0101 * error);
  }
  const auto text = run("lumigrid", {"info", scene});
  EXPECT_NE(text.out.find("octree: "), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("level  0:       1 nodes"), std::string::npos) << text.out;
}

TEST_F(HlodBuild, verifyNamesTheFileWhereAByteDiffersAnywhere) {
  const std::string mesh = sample("30000"), scene = path("scene");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  const std::string whole = readText(scene + "/hlod.lgh");
  for (const std::size_t at : {std::size_t{9}, std::size_t{200}, whole.size() / 2, whole.size() - 1}) {
    std::string rotten = whole;
    rotten[at] = static_cast<char>(~rotten[at]);
    programs::writeText(scene + "/hlod.lgh", rotten);
    const auto found = run("lumigrid", {"verify", scene, "--quiet"});
    EXPECT_EQ(found.status, 1) << at;
    EXPECT_NE(found.out.find("hlod.lgh: its SHA-256"), std::string::npos) << found.out;
    // The file tells by itself, too.
    EXPECT_GE(std::count(found.out.begin(), found.out.end(), '\n'), 3) << at << ": " << found.out;
  }
}

// A scene that has patches gets the octree beside them, the same as alone.
TEST_F(HlodBuild, addedToAFinishedSceneItIsTheSame) {
  const std::string mesh = sample("30000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  ASSERT_EQ(run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch", "--quiet"}).status, 0);
  const std::string patches = readText(scene + "/patch.lgp");
  const auto lacking = run("lumigrid", build(mesh, scene, {"--missing", "--json"}));
  EXPECT_EQ(lacking.status, 3) << lacking.out;
  EXPECT_EQ(json::parse(lacking.out)["hlod"], "missing");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  EXPECT_TRUE(readText(scene + "/hlod.lgh") == bytes);
  EXPECT_TRUE(readText(scene + "/patch.lgp") == patches);
  const auto again = run("lumigrid", {"build", "-o", scene, "--quiet"});
  EXPECT_NE(again.out.find("nothing was to be done"), std::string::npos) << again.out << again.err;
}

TEST_F(HlodBuild, otherOptionsThanThoseOfAFinishedSceneAreRefused) {
  const std::string mesh = sample("30000"), scene = path("scene");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  for (const Arguments& other :
       {Arguments{"--hlod-triangles", "3000"}, Arguments{"--hlod-triangles", "2000", "--hlod-resolution", "64"},
        Arguments{"--hlod-triangles", "2000", "--appearance", "normals"},
        Arguments{"--hlod-triangles", "2000", "--position-bits", "20"},
        Arguments{"--hlod-triangles", "2000", "--stitch", "off"}}) {
    Arguments arguments{"build", mesh, "-o", scene, "--methods", "hlod", "--quiet"};
    arguments.insert(arguments.end(), other.begin(), other.end());
    expectOneLineError(run("lumigrid", arguments), 1, {"other meshes or options"});
  }
  const auto stitched =
      run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch", "--stitch", "off", "--quiet"});
  expectOneLineError(stitched, 1, {"other meshes or options"});
  expectOneLineError(
      run("lumigrid", {"build", mesh, "-o", path("new"), "--methods", "patch", "--appearance", "normals"}), 2,
      {"--methods hlod"});
}

TEST_F(HlodBuild, killedAtSharesOfItsWorkFilesItEndsWithTheSameBytes) {
  const std::string mesh = sample(longTests() ? "500000" : "150000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  const auto workBytes = [&] {
    std::uintmax_t sum = 0;
    std::error_code error;
    for (fs::recursive_directory_iterator it(scene, error), end; it != end; it.increment(error))
      if (it->is_regular_file(error)) sum += sizeOf(it->path().string());
    return sum;
  };
  for (const double share : {0.3, 1.0, 3.0}) {
    const auto limit = static_cast<std::uintmax_t>(share * static_cast<double>(bytes.size()));
    killWhen(build(mesh, scene, {"--threads", "1"}), [&] { return workBytes() > limit; });
    if (fs::exists(scene + "/scene.json")) fs::remove_all(scene);
  }
  expectRerunFinishes(mesh, scene, bytes, "killed three times");
}

TEST_F(HlodBuild, memoryAndThreadsDoNotChangeTheBytes) {
  const std::string mesh = sample(longTests() ? "3000000" : "100000");
  const std::string bytes = uninterrupted(mesh);
  for (const Arguments& choice :
       {Arguments{"--memory", "256M", "--threads", "1"}, Arguments{"--memory", "4G", "--threads", "3"}}) {
    const auto built = run("lumigrid", build(mesh, path("scene"), choice));
    ASSERT_EQ(built.status, 0) << built.err;
    expectFinished(path("scene"), bytes, choice[1] + " " + choice[3]);
    fs::remove_all(path("scene"));
  }
}

TEST_F(HlodBuild, pointsWithoutFacesAreRefusedAndNothingStays) {
  const std::string points = path("points.ply");
  ASSERT_EQ(run("lumigrid", {"sample", "--triangles", "10000", "--points", "-o", points}).status, 0);
  expectOneLineError(run("lumigrid", build(points, path("scene"))), 1, {"points.ply"});
  EXPECT_FALSE(fs::exists(path("scene/scene.json")));
  EXPECT_FALSE(fs::exists(path("scene/hlod.lgh")));
}

TEST_F(HlodBuild, whatTheSourceOrTheSceneLacksIsSaid) {
  programs::writeText(path("plain.ply"),
                      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
                      "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
                      "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n");
  const auto built = run("lumigrid", build(path("plain.ply"), path("scene"), {"--appearance", "colors"}));
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_NE(built.err.find("the source has no colours"), std::string::npos) << built.err;

  programs::writeText(path("c.json"), "{\"position\":[0,0,3],\"direction\":[0,0,-1],\"width\":9,\"height\":9}");
  expectOneLineError(run("lumigrid", {"render", path("scene"), "--camera", path("c.json"), "-o", path("x.png")}), 1,
                     {"scene has no patches", "--method hlod"});
  expectOneLineError(run("lumigrid", {"tour", path("scene"), "--random", "2", "-o", path("t.json")}), 1,
                     {"scene has no patches", "--frames"});
}

TEST_F(HlodBuild, publishNamesTheFileByItsContent) {
  const std::string mesh = sample("30000"), scene = path("scene"), place = path("site");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  const auto published = run("lumigrid", {"publish", scene, place, "--viewer", "off", "--json"});
  ASSERT_EQ(published.status, 0) << published.err;
  EXPECT_EQ(json::parse(published.out)["part_bytes"], sizeOf(scene + "/hlod.lgh"));
  const auto verified = run("lumigrid", {"verify", place, "--quiet"});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
  const std::string file = json::parse(readText(place + "/scene.json"))["parts"][0]["file"];
  EXPECT_EQ(file.rfind("hlod-", 0), 0U) << file;
  EXPECT_TRUE(readText(place + "/" + file) == readText(scene + "/hlod.lgh"));

  // A file that no reader takes is not published, though it is the one that the scene lists.
  std::string broken = readText(scene + "/hlod.lgh");
  broken[40] = static_cast<char>(~broken[40]);
  programs::writeText(scene + "/hlod.lgh", broken);
  json document = json::parse(readText(scene + "/scene.json"));
  document["parts"][0]["sha256"] = base::hexOf(base::sha256(base::viewOfText(broken)));
  programs::writeText(scene + "/scene.json", document.dump());
  expectOneLineError(run("lumigrid", {"publish", scene, path("other"), "--viewer", "off"}), 1, {"hlod.lgh", "header"});
  EXPECT_FALSE(fs::exists(path("other/scene.json")));
}

}  // namespace
