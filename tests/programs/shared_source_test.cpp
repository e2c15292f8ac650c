// Methods that are built by one command read and sort their source once, and end with the same bytes as by themselves,
// killed on their way or not.
#include <gtest/gtest.h>

#include <map>

#include "tests/programs/resumed_build.h"

namespace {

namespace fs = std::filesystem;
using programs::readText;

class SharedSourceBuild : public programs::ResumedBuild {
 protected:
  SharedSourceBuild() { method_ = "patch,qsplat,hlod"; }

  const std::map<std::string, std::string> files_{
      {"patch", "patch.lgp"}, {"qsplat", "qsplat.lgq"}, {"hlod", "hlod.lgh"}};

  /// Builds each method by itself and keeps its bytes.
  void buildAlone(const std::string& mesh) {
    for (const auto& [method, file] : files_) {
      const std::string scene = path("alone");
      const auto built = run("lumigrid", {"build", mesh, "-o", scene, "--methods", method, "--quiet"});
      ASSERT_EQ(built.status, 0) << built.err;
      alone_[file] = readText(scene + "/" + file);
      fs::remove_all(scene);
    }
  }

  void expectAllAsAlone(const std::string& mesh, const std::string& scene, const std::string& what) {
    const auto built = run("lumigrid", build(mesh, scene));
    ASSERT_EQ(built.status, 0) << what << ": " << built.err;
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(scene)) names.push_back(entry.path().filename());
    std::sort(names.begin(), names.end());
    EXPECT_EQ(names, (std::vector<std::string>{"build.json", "hlod.lgh", "patch.lgp", "qsplat.lgq", "scene.json"}))
        << what << ": work files stayed";
    for (const auto& [file, bytes] : alone_)
      EXPECT_TRUE(readText(scene + "/" + file) == bytes) << what << ": other bytes in " << file;
  }

  std::map<std::string, std::string> alone_;  // bytes by file
};

TEST_F(SharedSourceBuild, methodsBuiltTogetherAreAsBuiltAlone) {
  const std::string mesh = sample("60000");
  ASSERT_NO_FATAL_FAILURE(buildAlone(mesh));
  expectAllAsAlone(mesh, path("scene"), "together");
}

TEST_F(SharedSourceBuild, killedAnywhereTheyEndWithTheSameBytesAndLeaveNothing) {
  const std::string mesh = sample("300000");
  ASSERT_NO_FATAL_FAILURE(buildAlone(mesh));
  const std::string scene = path("scene");
  for (const char* file : {"source.work/vertices", "source.work/stage1", "source.work/stage2", "patch.lgp.work/patches",
                           "qsplat.lgq.work/buckets", "qsplat.lgq.work/nodes", "hlod.lgh.work/ordered",
                           "hlod.lgh.work/stage3", "source.work/stage3"}) {
    int kills = 0;
    while (kills < 2 && killWhen(build(mesh, scene), [&] { return fs::exists(scene + "/" + file); })) ++kills;
    for (const char* own : {"patch.lgp.work/", "hlod.lgh.work/"})
      for (const char* of_source : {"vertices", "triangles", "buckets"})
        EXPECT_FALSE(fs::exists(scene + "/" + own + of_source)) << own << of_source << " when there was " << file;
    expectAllAsAlone(mesh, scene, std::string("killed when there was ") + file);
    fs::remove_all(scene);
    if (HasFailure()) return;
  }
}

// The last method that sorts triangles gives the buckets' room back; then a method that is wanted anew reads all again.
TEST_F(SharedSourceBuild, aMethodThatIsLostAfterTheSourceIsGoneIsBuiltAgain) {
  const std::string mesh = sample("300000");
  ASSERT_NO_FATAL_FAILURE(buildAlone(mesh));
  const std::string scene = path("scene");
  ASSERT_NO_FATAL_FAILURE(killedWhen(mesh, scene, [&] { return fs::exists(scene + "/source.work/stage3"); }));
  for (const char* file : {"patch.lgp", "qsplat.lgq"}) ASSERT_TRUE(fs::remove(scene + "/" + file));
  expectAllAsAlone(mesh, scene, "without what had been built");
}

// A command that wants less than the one that was killed removes what that one had kept for others.
TEST_F(SharedSourceBuild, whatWasKeptForOthersGoesWithTheScene) {
  const std::string mesh = sample("300000");
  const std::string scene = path("scene");
  ASSERT_NO_FATAL_FAILURE(killedWhen(mesh, scene, [&] { return fs::exists(scene + "/source.work/stage2"); }));
  const auto built = run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch", "--quiet", "--force"});
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_FALSE(fs::exists(scene + "/source.work"));
}

TEST_F(SharedSourceBuild, aCloudIsRefusedByTheMethodThatNeedsTriangles) {
  programs::writeText(path("cloud.xyz"), "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n");
  const auto alone = run("lumigrid", {"build", path("cloud.xyz"), "-o", path("a"), "--methods", "hlod"});
  const auto both = run("lumigrid", {"build", path("cloud.xyz"), "-o", path("b"), "--methods", "qsplat,hlod"});
  EXPECT_EQ(alone.status, both.status);
  EXPECT_NE(both.status, 0);
  const auto lastLine = [](const std::string& text) { return text.substr(text.rfind("lumigrid:")); };
  ASSERT_NE(both.err.find("lumigrid:"), std::string::npos) << both.err;
  EXPECT_EQ(lastLine(alone.err), lastLine(both.err));
}

}  // namespace
