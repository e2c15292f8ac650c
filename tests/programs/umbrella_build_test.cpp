// lumigrid build --methods pmr as a user runs it: from clouds and meshes, beside other methods, killed and resumed.
#include <nlohmann/json.hpp>
#include <random>

#include "tests/programs/resumed_build.h"
#include "tests/support/las_file.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::longTests;
using programs::readText;
using programs::run;

class UmbrellaBuild : public programs::ResumedBuild {
 protected:
  UmbrellaBuild() {
    method_ = "pmr";
    file_ = "pmr.lgm";
  }
  /// A wavy sheet of points as a PLY file without faces; `copies` of each.
  std::string cloud(int side, int copies = 1) {
    std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(copies * side * side) +
                       "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar "
                       "green\nproperty uchar blue\nend_header\n";
    std::mt19937 random(7);
    std::uniform_real_distribution<double> jitter(-0.3, 0.3);
    for (int i = 0; i < side; ++i)
      for (int j = 0; j < side; ++j) {
        const double x = i + jitter(random), y = j + jitter(random);
        const std::string line = std::to_string(x) + " " + std::to_string(y) + " " +
                                 std::to_string(3.0 * std::sin(0.1 * x) * std::cos(0.13 * y)) + " " +
                                 std::to_string(i % 256) + " " + std::to_string(j % 256) + " 90\n";
        for (int copy = 0; copy < copies; ++copy) text += line;
      }
    programs::writeText(path("cloud.ply"), text);
    return path("cloud.ply");
  }
  static json infoOf(const std::string& scene) {
    const auto info = run("lumigrid", {"info", scene, "--json"});
    EXPECT_EQ(info.status, 0) << info.err;
    return json::parse(info.out, nullptr, false);
  }
};

TEST_F(UmbrellaBuild, pointsAsTextMakeTheFileOfTheirPly) {
  const std::string ply = readText(cloud(30)), end_of_header = "end_header\n";
  programs::writeText(path("cloud.txt"), ply.substr(ply.find(end_of_header) + end_of_header.size()));
  for (const std::string name : {"cloud.txt", "cloud.ply"})
    ASSERT_EQ(run("lumigrid", build(path(name), path(name + ".scene"))).status, 0);
  EXPECT_TRUE(readText(path("cloud.txt.scene/pmr.lgm")) == readText(path("cloud.ply.scene/pmr.lgm")));
}

TEST_F(UmbrellaBuild, aBareCloudBecomesASceneThatIsWell) {
  const std::string scene = path("scene");
  const auto built = run("lumigrid", build(cloud(60), scene, {"--json"}));
  ASSERT_EQ(built.status, 0) << built.err;
  const json pmr = json::parse(built.out)["pmr"];
  EXPECT_EQ(pmr["points"], 3600);
  EXPECT_EQ(pmr["duplicates"], 0);
  EXPECT_EQ(pmr["levels"].size(), 11U);
  EXPECT_EQ(pmr["levels"][0]["points"], 3600);
  EXPECT_GT(pmr["levels"][0]["triangles"].get<int>(), 3600);
  EXPECT_LT(pmr["levels"][10]["points"].get<int>(), 2400);
  EXPECT_EQ(infoOf(scene)["pmr"]["levels"], pmr["levels"]);
  const json document = json::parse(readText(scene + "/scene.json"));
  EXPECT_EQ(document["triangles"], 0);
  EXPECT_EQ(document["has_colors"], true);
  EXPECT_EQ(document["parameters"]["methods"], "pmr");
  ASSERT_EQ(document["parts"].size(), 1U);
  EXPECT_EQ(document["parts"][0]["file"], "pmr.lgm");
  const auto verified = run("lumigrid", {"verify", scene, "--quiet"});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
  const auto again = run("lumigrid", build(path("cloud.ply"), scene));
  EXPECT_NE(again.out.find("nothing was to be done"), std::string::npos) << again.out << again.err;
}

TEST_F(UmbrellaBuild, duplicatesAreLeftOutAndCounted) {
  const auto built = run("lumigrid", build(cloud(40, 2), path("scene"), {"--json"}));
  ASSERT_EQ(built.status, 0) << built.err;
  const json pmr = json::parse(built.out)["pmr"];
  EXPECT_EQ(pmr["points"], 1600);
  EXPECT_EQ(pmr["duplicates"], 1600);
}

TEST_F(UmbrellaBuild, aCloudHasSplatsAndUmbrellasTogetherButNoPatches) {
  const std::string points = cloud(40), scene = path("scene");
  const auto built = run("lumigrid", {"build", points, "-o", scene, "--methods", "qsplat,pmr", "--quiet"});
  ASSERT_EQ(built.status, 0) << built.err;
  const json info = infoOf(scene);
  EXPECT_EQ(info["pmr"]["points"], info["qsplat"]["leaves"]);
  EXPECT_EQ(run("lumigrid", {"verify", scene, "--quiet"}).status, 0);
  EXPECT_EQ(run("lumigrid", {"build", points, "-o", path("no"), "--methods", "patch,pmr", "--quiet"}).status, 1);
  const auto chosen = run("lumigrid", {"build", points, "-o", path("auto"), "--methods", "auto,pmr"});
  EXPECT_EQ(chosen.status, 0) << chosen.err;
  EXPECT_NE(chosen.err.find("so only pmr is built"), std::string::npos) << chosen.err;
}

TEST_F(UmbrellaBuild, aLasFileIsReadToo) {
  support::LasFile las;
  for (int i = 0; i < 900; ++i) {
    support::LasPoint point;
    point.number = {i % 30 * 500, i / 30 * 500, (i * 7919) % 40};
    las.points.push_back(point);
  }
  programs::writeText(path("a.las"), bytesOf(las));
  ASSERT_EQ(run("lumigrid", build(path("a.las"), path("scene"))).status, 0);
  EXPECT_EQ(infoOf(path("scene"))["pmr"]["points"], 900);
}

// A scene that has patches gets umbrellas beside them, the same as alone.
TEST_F(UmbrellaBuild, addedToAFinishedSceneTheyAreTheSame) {
  const std::string mesh = sample("30000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  ASSERT_EQ(run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch,qsplat", "--quiet"}).status, 0);
  const std::string patches = readText(scene + "/patch.lgp"), splats = readText(scene + "/qsplat.lgq");
  const auto lacking = run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch,pmr", "--missing", "--json"});
  EXPECT_EQ(lacking.status, 3) << lacking.out;
  EXPECT_EQ(json::parse(lacking.out)["pmr"], "missing");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  EXPECT_TRUE(readText(scene + "/pmr.lgm") == bytes);
  EXPECT_TRUE(readText(scene + "/patch.lgp") == patches);
  EXPECT_TRUE(readText(scene + "/qsplat.lgq") == splats);
  const auto verified = run("lumigrid", {"verify", scene, "--quiet"});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
  const auto again = run("lumigrid", {"build", "-o", scene, "--quiet"});
  EXPECT_NE(again.out.find("nothing was to be done"), std::string::npos) << again.out << again.err;
}

TEST_F(UmbrellaBuild, killedWithinEachStageItEndsWithTheSameBytes) {
  const std::string mesh = sample("200000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  for (const char* file : {"vertices", "points", "stage2", "ordered", "classes", "leaves", "stage5"}) {
    int kills = 0;
    while (kills < 2 && killWhen(build(mesh, scene), [&] { return fs::exists(workFile(scene, file)); })) ++kills;
    expectRerunFinishes(mesh, scene, bytes, std::string("killed when there was ") + file);
    fs::remove_all(scene);
  }
}

TEST_F(UmbrellaBuild, killedAtSharesOfItsWorkFilesItEndsWithTheSameBytes) {
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
  for (const double share : {0.3, 1.0, 1.7}) {
    const auto limit = static_cast<std::uintmax_t>(share * static_cast<double>(bytes.size()));
    killWhen(build(mesh, scene, {"--threads", "1"}), [&] { return workBytes() > limit; });
    if (fs::exists(scene + "/scene.json")) fs::remove_all(scene);
  }
  expectRerunFinishes(mesh, scene, bytes, "killed three times");
}

TEST_F(UmbrellaBuild, memoryAndThreadsDoNotChangeTheBytes) {
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

TEST_F(UmbrellaBuild, memoryStaysUnderItsCeiling) {
  const std::string mesh = sample(longTests() ? "5000000" : "500000");
  const auto built = run("lumigrid", build(mesh, path("scene"), {"--memory", "512M", "--threads", "4"}));
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_LT(built.peak_memory_bytes, std::uint64_t{512} << 20);
}

TEST_F(UmbrellaBuild, aFileThatCannotBeReadIsNamedAndNothingStays) {
  programs::writeText(path("broken.ply"), "ply\nformat ascii 1.0\nelement vertex 3\n");
  expectOneLineError(run("lumigrid", build(path("broken.ply"), path("scene"))), 1, {"broken.ply"});
  EXPECT_FALSE(fs::exists(path("scene/scene.json")));
  EXPECT_FALSE(fs::exists(path("scene/pmr.lgm")));
}

}  // namespace
