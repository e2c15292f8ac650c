// Bad input ends in one line that names the file, the place and what to do, and leaves nothing half-written.
#include <sys/mount.h>
#include <sys/socket.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <netinet/in.h>

#include <cerrno>
#include <cstring>

#include "tests/programs/run_program.h"

namespace {

using programs::expectOneLineError;
using programs::run;

class BadInput : public programs::ProgramTest {
 protected:
  // Builds from a mesh file with this text; expects a refusal that leaves no output.
  void expectRefused(const std::string& name, const std::string& text, const std::vector<std::string>& pieces) {
    programs::writeText(path(name), text);
    const auto outcome = run("lumigrid", {"build", path(name), "-o", path("out"), "--quiet"});
    auto all = pieces;
    all.push_back(name);
    expectOneLineError(outcome, 1, all);
    EXPECT_FALSE(std::filesystem::exists(path("out"))) << "half-written output";
  }
};

const std::string kTriangle =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face "
    "1\nproperty list uchar int vertex_indices\nend_header\n";

TEST_F(BadInput, aMissingFileIsNamed) {
  expectOneLineError(run("lumigrid", {"build", path("no.ply"), "-o", path("out"), "--quiet"}), 1,
                     {"no.ply", "No such file"});
  EXPECT_FALSE(std::filesystem::exists(path("out")));
}

TEST_F(BadInput, aTruncatedPlyIsNamed) {
  const std::string whole = programs::readText(smallMesh());
  expectRefused("cut.ply", whole.substr(0, whole.size() / 2), {});
}

TEST_F(BadInput, anIndexOutOfRangeIsNamed) {
  expectRefused("index.ply", kTriangle + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", {"7", "out of range"});
}
TEST_F(BadInput, notANumberIsNamed) {
  expectRefused("nan.ply", kTriangle + "0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n", {"vertex 1"});
}
TEST_F(BadInput, anEmptyFileIsNamed) {
  expectRefused("empty.ply", "", {});
}
TEST_F(BadInput, aMeshWithoutTrianglesIsNamed) {
  expectRefused("none.ply",
                "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float "
                "z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n",
                {});
}
TEST_F(BadInput, noTriangleLeftAfterCleaningIsNamed) {
  expectRefused("flat.ply", kTriangle + "0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n", {"no triangle"});
}
TEST_F(BadInput, anUnknownFormatIsNamed) {
  expectRefused("mesh.xyz", "what is this\n", {});
}

TEST_F(BadInput, wrongUsageIsStatusTwo) {
  EXPECT_EQ(run("lumigrid", {"build", "a.ply"}).status, 2);
  EXPECT_EQ(run("lumigrid", {"build", "a.ply", "-o", path("o"), "--quality", "0"}).status, 2);
  EXPECT_EQ(run("lumigrid", {}).status, 2);
  EXPECT_EQ(run("lumigrid", {"frobnicate"}).status, 2);
}

TEST_F(BadInput, optionsOfAnotherMethodAreWrongUsage) {
  const auto render = [&](const std::vector<std::string>& options) {
    std::vector<std::string> all{"render", path("s"), "--camera", path("c.json"), "-o", path("x.png")};
    all.insert(all.end(), options.begin(), options.end());
    return run("lumigrid", all);
  };
  expectOneLineError(render({"--method", "hlod", "--guarantee"}), 2, {"--guarantee means nothing with --method hlod"});
  expectOneLineError(render({"--method", "patches", "--cutoff", "1"}), 2, {"--cutoff", "leave it out", "qsplat"});
  expectOneLineError(render({"--tolerance", "1"}), 2, {"--method full", "patches, pmr, hlod"});
  expectOneLineError(render({"--method", "hlod", "--tolerance", "0"}), 2, {"--tolerance must be above 0"});
  expectOneLineError(render({"--method", "patches", "--tolerance", "0", "--guarantee"}), 1, {"not a scene"});
}

TEST_F(BadInput, anOutputThatExistsNeedsForce) {
  const std::string scene = smallScene();
  const std::string before = programs::readText(scene + "/scene.json");
  expectOneLineError(run("lumigrid", {"build", smallMesh(), "-o", scene, "--quiet"}), 1, {scene, "--force"});
  EXPECT_EQ(programs::readText(scene + "/scene.json"), before);
  programs::writeText(path("file"), "x");
  expectOneLineError(run("lumigrid", {"build", smallMesh(), "-o", path("file"), "--quiet"}), 1, {"file"});
  std::filesystem::create_directories(path("other"));
  programs::writeText(path("other/precious"), "x");
  expectOneLineError(run("lumigrid", {"build", smallMesh(), "-o", path("other"), "--quiet"}), 1, {"not empty"});
  EXPECT_EQ(programs::readText(path("other/precious")), "x");
}

TEST_F(BadInput, forceRemovesAllCountsOfTheSceneBefore) {
  const std::string scene = smallScene();
  const std::vector<std::string> counts{scene + "/access.lga", scene + "/access-0123456789abcdef.lga"};
  for (const std::string& file : counts) programs::writeText(file, "counts");
  ASSERT_EQ(run("lumigrid", {"build", smallMesh(), "-o", scene, "--force", "--methods", "patch", "--quiet"}).status, 0);
  for (const std::string& file : counts) EXPECT_FALSE(std::filesystem::exists(file)) << file;
}

TEST_F(BadInput, anUnfinishedBuildOfOtherOptionsIsNotMixedIn) {
  const std::string scene = smallScene();
  std::filesystem::rename(scene + "/scene.json", scene + "/building.json");
  expectOneLineError(run("lumigrid", {"build", smallMesh(), "-o", scene, "--grid", "4", "--face", "64", "--quiet"}), 1,
                     {"other meshes or options", "--force"});
  expectOneLineError(run("lumigrid", {"info", scene}), 1, {"not finished"});
}

TEST_F(BadInput, aFullDiskIsNamedAndTheRerunFinishes) {
  std::filesystem::create_directories(path("disk"));
  if (::mount("none", path("disk").c_str(), "tmpfs", 0, "size=256k") != 0)
    GTEST_SKIP() << "cannot mount a small file system here: " << std::strerror(errno);
  const std::string mesh = smallMesh();
  const std::vector<std::string> build{"build", mesh,     "-o", path("disk/scene"), "--grid",
                                       "3",     "--face", "64", "--quiet"};
  const auto full = run("lumigrid", build);
  EXPECT_EQ(full.status, 1);
  EXPECT_NE(full.err.find("space"), std::string::npos) << full.err;
  EXPECT_FALSE(std::filesystem::exists(path("disk/scene/scene.json")));
  ASSERT_EQ(::mount("none", path("disk").c_str(), "tmpfs", MS_REMOUNT, "size=256m"), 0) << std::strerror(errno);
  const auto rerun = run("lumigrid", build);
  EXPECT_EQ(rerun.status, 0) << rerun.err;
  EXPECT_EQ(run("lumigrid", {"verify", path("disk/scene")}).status, 0);
  ::umount2(path("disk").c_str(), MNT_DETACH);
}

TEST_F(BadInput, aPortInUseIsNamed) {
  const std::string scene = smallScene();
  const int listener = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* any = reinterpret_cast<sockaddr*>(&address);
  socklen_t length = sizeof(address);
  ASSERT_EQ(::bind(listener, any, length), 0);
  ASSERT_EQ(::listen(listener, 1), 0);
  ASSERT_EQ(::getsockname(listener, any, &length), 0);
  const std::string port = std::to_string(ntohs(address.sin_port));
  expectOneLineError(run("lumigrid", {"serve", scene, "--port", port}), 1, {port, "in use", "--port"});
  ::close(listener);
}

TEST_F(BadInput, everyCommandNamesAFolderThatIsNoScene) {
  std::filesystem::create_directories(path("empty"));
  for (const char* command : {"info", "verify", "serve"})
    expectOneLineError(run("lumigrid", {command, path("empty")}), 1, {"empty", "not a scene"});
  programs::writeText(path("c.json"), "{\"position\":[0,0,1],\"direction\":[0,0,-1]}");
  expectOneLineError(run("lumigrid", {"render", path("empty"), "--camera", path("c.json"), "-o", path("x.png")}), 1,
                     {"not a scene"});
}

TEST_F(BadInput, aServerThatIsNotThereIsNamedByTheViewer) {
  programs::writeText(path("p.json"), "{\"frames\":[{\"position\":[0,0,1],\"direction\":[0,0,-1]}]}");
  const auto outcome = run("lumigrid-view", {"ws://127.0.0.1:1/", "--headless", "--path", path("p.json"), "--out",
                                             path("o"), "--connect-timeout", "1"});
  EXPECT_EQ(outcome.status, 1);
  EXPECT_NE(outcome.err.find("127.0.0.1:1"), std::string::npos) << outcome.err;
  const auto folder = run("lumigrid-view", {"no.such.host.invalid/scene", "--headless", "--path", path("p.json"),
                                            "--out", path("o"), "--connect-timeout", "1"});
  EXPECT_EQ(folder.status, 1);
  EXPECT_NE(folder.err.find("nor is there a scene in a folder 'no.such.host.invalid/scene'"), std::string::npos)
      << folder.err;
}

}  // namespace
