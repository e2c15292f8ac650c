// lumigrid-view streams splats from nginx and from a server of ours, as a user has them.
#include <cstdio>
#include <filesystem>
#include <regex>

#include "lod/qsplat/format.h"
#include "tests/programs/published_site.h"
#include "tests/support/byte_ranges.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::readText;
using programs::run;
using programs::Tour;
using programs::writeText;

constexpr int kFrames = 4;

/// path("site/tower") is the published form of scene_: patches and splats.
class StreamedSplatsTest : public programs::PublishedSite {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    LUMIGRID_SKIP_WITHOUT_NGINX();
    scene_ = path("scene");
    ASSERT_EQ(run("lumigrid", {"sample", "--triangles", "60000", "-o", path("mesh.ply")}).status, 0);
    std::vector<std::string> build{"build", path("mesh.ply"), "-o", scene_, "--methods", "patch,qsplat", "--quiet"};
    build.insert(build.end(), form_.begin(), form_.end());
    const auto built = run("lumigrid", build);
    ASSERT_EQ(built.status, 0) << built.err;
    ASSERT_EQ(run("lumigrid", {"publish", scene_, path("site/tower"), "--quiet"}).status, 0);
    makeTour(kFrames, 320, 180);
  }
  /// Streams a tour from nginx.
  void expectLocalPicturesFromNginx(std::uint64_t most_repeated);

  std::vector<std::string> form_;  ///< options of the build

  programs::Outcome view(const std::string& url, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{url,      "--headless",      "--method",          "qsplat",
                                       "--path", path("tour.json"), "--connect-timeout", "3"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run("lumigrid-view", arguments);
  }
  std::string splatFile() const {
    for (const auto& entry : fs::directory_iterator(path("site/tower")))
      if (entry.path().extension() == ".lgq") return entry.path().string();
    return "";
  }
  void expectLocalPictures(const Tour& streamed) { PublishedSite::expectLocalPictures(streamed, "qsplat"); }
};

void StreamedSplatsTest::expectLocalPicturesFromNginx(std::uint64_t most_repeated) {
  const support::Nginx nginx(support::Nginx::Configuration{
      "log_format ranges '$status bytes=$http_range $uri';\nserver {\nlisten 127.0.0.1:$PORT0;\nroot " + path("site") +
      ";\naccess_log " + path("ranges.log") + " ranges;\n}\n"});
  const Tour streamed = tour(nginx.url() + "/tower/", "streamed", "qsplat");
  expectLocalPictures(streamed);

  const std::string log = readText(path("ranges.log"));
  support::ByteRanges ranges;
  const std::regex line("206 bytes=bytes=(\\d+)-(\\d+) (\\S+)");
  for (std::sregex_iterator it(log.begin(), log.end(), line), end; it != end; ++it)
    ranges[(*it)[3]].emplace_back(std::stoull((*it)[1]), std::stoull((*it)[2]) + 1);
  ASSERT_EQ(ranges.size(), 1U) << "the splats' file alone is read by ranges";
  EXPECT_GT(ranges.begin()->second.size(), 10U);
  EXPECT_LE(support::bytesRepeated(ranges), most_repeated);
  EXPECT_EQ(streamed.lines.back()["splats"]["wanted"], 0);
  EXPECT_EQ(streamed.lines.back()["splats"]["failures"], 0);
  EXPECT_GT(streamed.lines.back()["splats"]["drawn"].get<int>(), 1000);

  // A second tour shows the same; the kernels are those of `lumigrid render`, too.
  const auto ellipses = view(nginx.url() + "/tower/", {"--splat", "ellipse", "--out", path("ellipses")});
  ASSERT_EQ(ellipses.status, 0) << ellipses.err;
  EXPECT_NE(readText(path("ellipses/frame_0000.png")), readText(path("streamed/frame_0000.png")));
}

TEST_F(StreamedSplatsTest, fullyStreamedPicturesEqualLocalOnesPixelForPixelAndNoByteComesTwice) {
  expectLocalPicturesFromNginx(0);
}

class CodedSplatsTest : public StreamedSplatsTest {
 protected:
  CodedSplatsTest() { form_ = {"--qsplat-coded"}; }
};

// The piece of a block at the end of the first answer comes twice.
TEST_F(CodedSplatsTest, fullyStreamedPicturesEqualLocalOnesPixelForPixel) {
  expectLocalPicturesFromNginx(lod::qsplat::kMaxCodedBytes);
  const auto verified = run("lumigrid", {"verify", path("site/tower")});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
}

TEST_F(CodedSplatsTest, aServerOfOursStreamsThemToo) {
  expectLocalPictures(tour(serve(scene_).url, "served", "qsplat"));
  expectLocalPictures(tour(serve(path("site/tower")).url, "served_published", "qsplat"));
}

TEST_F(StreamedSplatsTest, aServerOfOursStreamsThemToo) {
  expectLocalPictures(tour(serve(scene_).url, "served", "qsplat"));
  expectLocalPictures(tour(serve(path("site/tower")).url, "served_published", "qsplat"));
}

// A server of a far scene keeps nothing but a cache.
TEST_F(StreamedSplatsTest, aServerOfOursPassesOnWhatLiesBehindANetwork) {
  const support::Nginx nginx(path("site"));
  const auto served = serve(nginx.url() + "/tower", {"--cache", path("cache")});
  expectLocalPictures(tour(served.url, "far", "qsplat"));
  EXPECT_NE(nginx.accessLog().find(".lgq"), std::string::npos);
}

TEST_F(StreamedSplatsTest, aSceneOnThisMachineIsShownWithoutAServer) {
  expectLocalPictures(tour(scene_, "folder", "qsplat"));
  expectLocalPictures(tour(scene_ + "/", "slash", "qsplat"));
  expectLocalPictures(tour(path("site/tower/scene.json"), "file", "qsplat"));
  // Built, it has patches for a server only, so that its splats are shown; published, its patches.
  expectLocalPictures(tour(scene_, "built", ""));
  const Tour patches = tour(path("site/tower"), "published", "");
  const Tour served = tour(serve(path("site/tower")).url, "served", "");
  ASSERT_EQ(patches.pictures.size(), served.pictures.size());
  for (std::size_t i = 0; i < served.pictures.size(); ++i)
    EXPECT_EQ(patches.pictures[i].pixels, served.pictures[i].pixels) << "frame " << i;
  EXPECT_GT(patches.lines.back()["patches"].get<int>(), 0);
}

TEST_F(CodedSplatsTest, aSceneOnThisMachineIsShownWithoutAServer) {
  expectLocalPictures(tour(scene_, "folder", "qsplat"));
}

TEST_F(StreamedSplatsTest, aFolderThatCannotBeShownIsNamedWithWhatToDo) {
  expectOneLineError(run("lumigrid-view", {scene_, "--headless", "--path", path("tour.json"), "--method", "patches"}),
                     1, {"lumigrid publish", "--method qsplat"});
  expectOneLineError(view(path("nothing")), 2, {"/nothing", "no scene is there"});
  expectOneLineError(view(scene_, {"--bandwidth", "1Mbit"}), 2, {"--bandwidth", "on this machine"});
  ASSERT_EQ(run("lumigrid", {"build", path("mesh.ply"), "-o", path("plain"), "--methods", "patch", "--quiet"}).status,
            0);
  expectOneLineError(view(path("plain")), 1, {"has no splats", "--methods qsplat"});
  fs::resize_file(scene_ + "/qsplat.lgq", 5000);
  expectOneLineError(view(scene_), 1, {"qsplat.lgq", "has 5000 bytes"});
}

/// Builds and publishes a scene of splats only.
class SplatsOnlyTest : public StreamedSplatsTest {
 protected:
  void SetUp() override {
    StreamedSplatsTest::SetUp();
    if (IsSkipped()) return;
    scene_ = path("alone");
    const auto built = run("lumigrid", {"build", path("mesh.ply"), "-o", scene_, "--methods", "qsplat", "--quiet"});
    ASSERT_EQ(built.status, 0) << built.err;
    ASSERT_EQ(run("lumigrid", {"publish", scene_, path("site/alone"), "--quiet"}).status, 0);
  }
  /// Asks for no method.
  Tour plainTour(const std::string& url, const std::string& name) { return tour(url, name, ""); }
};

TEST_F(SplatsOnlyTest, areShownWithoutBeingAskedForAsSuch) {
  const support::Nginx nginx(path("site"));
  expectLocalPictures(plainTour(serve(scene_).url, "served"));
  expectLocalPictures(plainTour(serve(path("site/alone")).url, "served_published"));
  expectLocalPictures(plainTour(serve(nginx.url() + "/alone", {"--cache", path("cache")}).url, "far"));
  expectLocalPictures(plainTour(nginx.url() + "/alone/", "published"));
}

TEST_F(SplatsOnlyTest, refusesOtherMethodsWithTheReason) {
  const support::Nginx nginx(path("site"));
  for (const std::string& url : {serve(scene_).url, nginx.url() + "/alone/"})
    expectOneLineError(run("lumigrid-view", {url, "--headless", "--method", "patches", "--path", path("tour.json"),
                                             "--connect-timeout", "3"}),
                       1, {"splats only", "--method qsplat"});
  EXPECT_EQ(run("lumigrid", {"info", scene_}).status, 0);
  EXPECT_EQ(run("lumigrid", {"verify", path("site/alone"), "--quiet"}).status, 0);
}

TEST_F(StreamedSplatsTest, connectionsThatAreDroppedNowAndThenChangeNoPicture) {
  const support::Nginx nginx(support::Nginx::Configuration{
      // nginx refuses every other connection by its count, not by chance, so a client that tries again is served.
      "map $connection $dropped { default 0; ~[02468]$ 1; }\nserver {\nlisten 127.0.0.1:$PORT0;\nroot " + path("site") +
      ";\nkeepalive_requests 3;\nlocation ~ lgq$ { if ($dropped) { return 444; } }\n}\n"});
  const Tour streamed = tour(nginx.url() + "/tower/", "dropped", "qsplat");
  expectLocalPictures(streamed);
  EXPECT_NE(nginx.accessLog().find("\" 444 "), std::string::npos) << "no connection was dropped";
}

TEST_F(StreamedSplatsTest, aHostThatCannotIsNamedWithWhatToDo) {
  const support::Nginx nginx(path("site"), "location /whole/ { alias " + path("site/tower") +
                                               "/; max_ranges 0; }\nlocation /secret/ { deny all; }\n");
  expectOneLineError(view(nginx.url() + "/whole/"), 1, {"/whole/qsplat-", "ignores Range", "docs/hosting.md"});
  expectOneLineError(view(nginx.url() + "/nothing/"), 1, {"/nothing/scene.json", "is not there", "404"});
  expectOneLineError(view(nginx.url() + "/secret/"), 1, {"may not be read", "403"});
  expectOneLineError(view("http://127.0.0.1:1/tower/"), 1, {"no answer", "check the network"});

  // The file is cut short, another one, lost; the scene has no splats.
  const std::string file = splatFile();
  const std::string bytes = readText(file);
  writeText(file, bytes.substr(0, 1'000));
  expectOneLineError(view(nginx.url() + "/tower/"), 1, {".lgq", "is shorter", "publish the scene again"});
  writeText(file, bytes.substr(0, 3 * bytes.size() / 4));
  expectOneLineError(view(nginx.url() + "/tower/"), 1, {".lgq", "is shorter", "publish the scene again"});
  writeText(file, "no splats" + bytes.substr(9));
  expectOneLineError(view(nginx.url() + "/tower/"), 1, {".lgq", "not a qsplat.lgq"});
  fs::remove(file);
  expectOneLineError(view(nginx.url() + "/tower/"), 1, {".lgq", "is not there"});
  ASSERT_EQ(
      run("lumigrid", {"build", path("mesh.ply"), "-o", path("site/plain"), "--methods", "patch", "--quiet"}).status,
      0);
  expectOneLineError(view(nginx.url() + "/plain/"), 1, {"has no splats", "--methods qsplat"});
}

TEST_F(StreamedSplatsTest, aDamagedBlockIsNamedAndCoarserSplatsStandInForIt) {
  const std::string file = splatFile();
  std::string bytes = readText(file);
  const std::size_t last = bytes.size() / lod::qsplat::kBlockBytes - 1;
  for (std::size_t block = last / 2; block < last; ++block) bytes[block * lod::qsplat::kBlockBytes + 500] ^= 4;
  writeText(file, bytes);
  const support::Nginx nginx(path("site"));
  const auto viewed = view(nginx.url() + "/tower/", {"--out", path("damaged")});
  EXPECT_EQ(viewed.status, 1);
  EXPECT_NE(viewed.err.find("damaged: checksum does not match"), std::string::npos) << viewed.err;
  const json line =
      json::parse(readText(path("damaged/frames.jsonl")).substr(0, readText(path("damaged/frames.jsonl")).find('\n')));
  EXPECT_TRUE(line["complete"].get<bool>());
  EXPECT_GT(line["broken"].get<int>(), 0);
  EXPECT_GT(line["splats"]["drawn"].get<int>(), 100);
  const auto verified = run("lumigrid", {"verify", path("site/tower"), "--quiet"});
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE(verified.out.find(".lgq: block"), std::string::npos) << verified.out;
}

TEST_F(StreamedSplatsTest, aFileThatChangesMeanwhileIsNamedAndNothingOfItIsMixedIn) {
  const support::Nginx nginx(path("site"));
  const pid_t viewer = programs::start("lumigrid-view",
                                       {nginx.url() + "/tower/", "--headless", "--method", "qsplat", "--path",
                                        path("tour.json"), "--bandwidth", "100kbit", "--settle", "60"},
                                       path("viewer"));
  // The viewer has begun to read.
  for (int i = 0; i < 2000 && nginx.accessLog().find(".lgq") == std::string::npos; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const std::string file = splatFile();
  fs::copy_file(scene_ + "/qsplat.lgq", path("other.lgq"));
  fs::last_write_time(path("other.lgq"), fs::file_time_type::clock::now() - std::chrono::hours(1));
  fs::rename(path("other.lgq"), file);
  EXPECT_EQ(programs::wait(viewer), 1);
  EXPECT_NE(readText(path("viewer.err")).find("changed while it was read; open the scene anew"), std::string::npos)
      << readText(path("viewer.err"));
}

}  // namespace
