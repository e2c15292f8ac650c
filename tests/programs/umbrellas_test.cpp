// Scenes of points and umbrellas as a user has them, but for the build: info, verify, serve, publish, set.
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <numeric>
#include <thread>

#include "tests/programs/pmr_scene.h"
#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::readText;
using programs::run;
using programs::writeText;

/// path("scene") holds a torus of points.
class Umbrellas : public programs::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    scene_ = path("scene");
    made_ = programs::writePmrScene(scene_);
  }
  void TearDown() override {
    if (server_ > 0) {
      ::kill(server_, SIGTERM);
      programs::wait(server_);
    }
    ProgramTest::TearDown();
  }
  std::string file() const { return scene_ + "/pmr.lgm"; }
  /// Returns the port.
  std::uint16_t serve(const std::string& what) {
    server_ = programs::start("lumigrid", {"serve", what, "--port", "0", "--json", "--no-frames"}, path("serve"));
    for (int i = 0; i < 2000; ++i) {
      const json said = json::parse(readText(path("serve.out")), nullptr, false);
      if (said.is_object()) return said["port"];
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    ADD_FAILURE() << readText(path("serve.err"));
    return 0;
  }
  std::string publishedFile(const std::string& place) const {
    for (const auto& entry : fs::directory_iterator(place))
      if (entry.path().extension() == ".lgm") return entry.path().filename();
    return "";
  }

  std::string scene_;
  support::MadePmr made_;
  pid_t server_ = 0;
};

TEST_F(Umbrellas, infoCountsPointsAndTrianglesAtEachLevel) {
  const auto info = run("lumigrid", {"info", scene_, "--json", "--digest"});
  ASSERT_EQ(info.status, 0) << info.err;
  const json pmr = json::parse(info.out)["pmr"];
  EXPECT_EQ(pmr["bytes"], made_.file.size());
  EXPECT_EQ(pmr["points"], made_.header.points);
  EXPECT_EQ(pmr["leaves"], made_.leaves.size());
  EXPECT_EQ(pmr["oriented"], true);
  EXPECT_EQ(pmr["sha256"].get<std::string>().size(), 64U);
  ASSERT_EQ(pmr["levels"].size(), lod::pmr::kLevels);
  for (std::uint32_t level = 0; level < lod::pmr::kLevels; ++level) {
    const auto sum = [&](auto count) {
      return std::accumulate(made_.leaves.begin(), made_.leaves.end(), std::uint64_t{0},
                             [&](std::uint64_t so_far, const lod::pmr::Leaf& leaf) { return so_far + count(leaf); });
    };
    EXPECT_EQ(pmr["levels"][level]["points"], sum([&](const auto& leaf) { return leaf.pointsAt(level); })) << level;
    EXPECT_EQ(pmr["levels"][level]["triangles"], sum([&](const auto& leaf) { return leaf.levels[level].triangles; }))
        << level;
  }
  const auto text = run("lumigrid", {"info", scene_});
  EXPECT_NE(text.out.find("16,384 points, colours: yes"), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("umbrellas: 16,384 points"), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("level 10:"), std::string::npos) << text.out;
}

TEST_F(Umbrellas, infoNamesADamagedFile) {
  writeText(file(), "no points" + std::string(5000, 'x'));
  expectOneLineError(run("lumigrid", {"info", scene_}), 1, {"pmr.lgm"});
  writeText(file(), std::string(made_.file.begin(), made_.file.begin() + 100));
  expectOneLineError(run("lumigrid", {"info", scene_}), 1, {"pmr.lgm"});
}

TEST_F(Umbrellas, verifyNamesTheFileWhereAByteDiffersAnywhere) {
  const auto well = run("lumigrid", {"verify", scene_, "--quiet"});
  EXPECT_EQ(well.status, 0) << well.out << well.err;
  const std::string whole(made_.file.begin(), made_.file.end());
  for (const std::size_t at : {std::size_t{9}, std::size_t{200}, whole.size() / 2, whole.size() - 1}) {
    std::string rotten = whole;
    rotten[at] = static_cast<char>(~rotten[at]);
    writeText(file(), rotten);
    const auto found = run("lumigrid", {"verify", scene_, "--quiet"});
    EXPECT_EQ(found.status, 1) << at;
    EXPECT_NE(found.out.find("pmr.lgm: its SHA-256"), std::string::npos) << found.out;
    // The file tells by itself, too.
    EXPECT_GE(std::count(found.out.begin(), found.out.end(), '\n'), 3) << at << ": " << found.out;
  }
  fs::remove(file());
  const auto gone = run("lumigrid", {"verify", scene_, "--quiet"});
  EXPECT_EQ(gone.status, 1);
  EXPECT_NE(gone.out.find("pmr.lgm: is missing"), std::string::npos) << gone.out;
}

TEST_F(Umbrellas, aServerAnswersByteRanges) {
  const std::uint16_t port = serve(scene_);
  const std::string whole(made_.file.begin(), made_.file.end());
  EXPECT_TRUE(server::httpRequest(port, "/pmr.lgm").body == whole);
  const auto part = server::httpRequest(port, "/pmr.lgm", {{"Range", "bytes=100-4099"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_TRUE(part.body == whole.substr(100, 4000));
  EXPECT_EQ(server::httpRequest(port, "/patch.lgp").status, 501);
  EXPECT_EQ(server::httpRequest(port, "/qsplat.lgq").status, 404);
}

TEST_F(Umbrellas, publishNamesTheFileByItsContentAndAServerServesThePlace) {
  const std::string place = path("site");
  const auto published = run("lumigrid", {"publish", scene_, place, "--viewer", "off", "--json"});
  ASSERT_EQ(published.status, 0) << published.err;
  EXPECT_EQ(json::parse(published.out)["part_bytes"], made_.file.size());
  const std::string name = publishedFile(place);
  EXPECT_TRUE(base::isPublishedName(name)) << name;
  EXPECT_EQ(name.rfind("pmr-", 0), 0U) << name;
  const auto verified = run("lumigrid", {"verify", place, "--quiet"});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
  const auto again = run("lumigrid", {"publish", scene_, place, "--viewer", "off", "--json"});
  EXPECT_EQ(json::parse(again.out)["bytes_written"], 0);
  expectOneLineError(run("lumigrid", {"publish", place, scene_, "--viewer", "off"}), 1, {"lumigrid build"});

  const std::uint16_t port = serve(place);
  EXPECT_EQ(server::httpRequest(port, "/" + name).body.size(), made_.file.size());
  EXPECT_EQ(server::httpRequest(port, "/pmr.lgm").body.size(), made_.file.size());
}

// A place behind a network is read by ranges.
TEST_F(Umbrellas, verifyReadsAPublishedScenesFileOverANetwork) {
  const std::string place = path("site");
  ASSERT_EQ(run("lumigrid", {"publish", scene_, place, "--viewer", "off", "--quiet"}).status, 0);
  const std::string url = "http://127.0.0.1:" + std::to_string(serve(place));
  const auto verified = run("lumigrid", {"verify", url, "--quiet"});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
}

TEST_F(Umbrellas, aFirstViewMayNameTheMethod) {
  const auto set = run("lumigrid", {"set", scene_, "--start-view", "v=1&p=3,0,0&a=180,0&r=3&m=pmr"});
  EXPECT_EQ(set.status, 0) << set.err;
  EXPECT_NE(readText(scene_ + "/scene.json").find("m=pmr"), std::string::npos);
}

#ifndef LUMIGRID_PMR

TEST_F(Umbrellas, aProgramWithoutTheBuilderSaysSoAndMakesNothing) {
  const std::string mesh = smallMesh();
  for (const char* methods : {"pmr", "patch,pmr", "auto,pmr"}) {
    const auto built = run("lumigrid", {"build", mesh, "-o", path("new"), "--methods", methods, "--quiet"});
    expectOneLineError(built, 1, {"LUMIGRID_PMR=ON", "docs/pmr.md"});
    EXPECT_FALSE(fs::exists(path("new/scene.json")));
    EXPECT_FALSE(fs::exists(path("new/patch.lgp")));
  }
  // The scene that --force would replace is still there.
  expectOneLineError(run("lumigrid", {"build", mesh, "-o", scene_, "--methods", "pmr", "--force", "--quiet"}), 1,
                     {"LUMIGRID_PMR=ON"});
  EXPECT_EQ(run("lumigrid", {"verify", scene_, "--quiet"}).status, 0);
}

#endif

}  // namespace
