// Tests comparisons in virtual time: the same figures again and again, links and methods that behave as they should,
// and the same end as over a socket.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/file.h"
#include "base/json/camera_file.h"
#include "compare/run.h"
#include "compare/sim/matrix.h"
#include "compare/sim/results.h"
#include "tests/support/baked_statue.h"
#include "tests/support/made_hlod.h"
#include "tests/support/test_meshes.h"

namespace {

using compare::PlayedRun;

class VirtualTime : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { support::bakeStatue("virtual_time", statue_); }
  static void TearDownTestSuite() { std::filesystem::remove_all(statue_.directory); }

  static compare::MatrixOptions optionsFor(std::vector<std::string> methods, const std::string& link) {
    compare::MatrixOptions options;
    options.scenes = {statue_.directory};
    options.methods = std::move(methods);
    options.parts = {{{"orbit"}, {compare::parseLink(link).value()}}};
    options.report = statue_.directory + "/report";
    options.truth_supersampling = 2;
    options.pictures = false;
    options.path = {160, 120, 2.0, 1};
    options.play.instants = 3;
    return options;
  }
  static std::vector<PlayedRun> play(const compare::MatrixOptions& options) {
    auto runs = compare::playMatrix(options, [](const std::string&) {});
    EXPECT_TRUE(runs) << runs.error().message;
    return runs ? std::move(*runs) : std::vector<PlayedRun>();
  }

  inline static support::BakedStatue statue_;
};

// Removes the last column, which holds wall times.
std::string withoutWallTime(const std::string& csv) {
  std::istringstream in(csv);
  std::string out;
  for (std::string line; std::getline(in, line);) out += line.substr(0, line.rfind(',')) + "\n";
  return out;
}

TEST_F(VirtualTime, givesTheSameFiguresTwice) {
  const auto options = optionsFor({}, "5Mbit/60ms/20ms/1%");  // all methods that the scene has data for
  const auto first = play(options);
  const auto written = nlohmann::json::parse(std::ifstream(options.report + "/results.json"));
  const auto second = play(options);
  ASSERT_GE(first.size(), 5U);
  EXPECT_EQ(withoutWallTime(compare::resultsCsv(first)), withoutWallTime(compare::resultsCsv(second)));
  EXPECT_EQ(withoutWallTime(compare::summaryCsv(first)), withoutWallTime(compare::summaryCsv(second)));
  for (const PlayedRun& run : first) {
    EXPECT_EQ(run.moving().size(), 3U) << run.setting.method;
    EXPECT_GT(run.frames.back().accuracy.psnr_db, 22.0) << run.setting.method;
    EXPECT_GE(run.rest_seconds, 0.0) << run.setting.method << " never came to rest";
    EXPECT_GT(run.meanFlicker().mean, 0.0) << run.setting.method;
  }
  EXPECT_EQ(written["parameters"]["seed"], options.play.seed);
  ASSERT_EQ(written["runs"].size(), first.size());
  EXPECT_EQ(written["runs"][0]["method"], first[0].setting.method);
  EXPECT_NEAR(written["runs"][0]["mean_psnr_db"].get<double>(), first[0].meanPsnr(), 1e-3);
}

TEST_F(VirtualTime, showsLaterWhatASlowerLinkBrings) {
  const auto slow = play(optionsFor({"lumigraph"}, "384kbit/100ms")).at(0);
  const auto fast = play(optionsFor({"lumigraph"}, "1Gbit/1ms")).at(0);
  ASSERT_EQ(slow.frames.size(), fast.frames.size());
  for (std::size_t i = 0; i + 1 < slow.frames.size(); ++i) {
    EXPECT_LE(slow.frames[i].counts.bytes, fast.frames[i].counts.bytes) << i;
    EXPECT_LE(slow.frames[i].counts.bytes, 48'000.0 * slow.frames[i].seconds) << i << ": more than the link carries";
  }
  EXPECT_GT(fast.meanPsnr(), slow.meanPsnr() + 1.0);
  EXPECT_LT(fast.secondsToFirst(), slow.secondsToFirst());
}

/// The figures of the picture judged at this time.
double psnrAt(const PlayedRun& run, double seconds) {
  for (const compare::DisplayedFrame& frame : run.frames)
    if (std::abs(frame.seconds - seconds) < 0.01) return frame.accuracy.psnr_db;
  ADD_FAILURE() << "no picture was judged at " << seconds << " s";
  return 0.0;
}

// A new connection needs two round trips until it stands, one for the greeting and one for the view; then the frame
// precedes the coarse model, and the last one the rest. The link is slow enough that either order would show.
TEST_F(VirtualTime, aFreshViewsFrameIsThereWithinAQuarterOfASecond) {
  auto options = optionsFor({"lumigraph"}, "5Mbit/40ms");
  options.parts[0].paths = {"teleports"};
  options.path = {640, 360, 4.0, 1};
  options.costs.server_render_seconds = 0.03;
  options.play.instants = 1;
  options.play.also_judged = {0.25, 2.25, 2.5};
  const auto run = play(options).at(0);
  const double at_rest = run.frames.back().accuracy.psnr_db;
  EXPECT_GT(at_rest, 50.0) << "of the last frame, which has no loss";
  EXPECT_GT(psnrAt(run, 0.25), 36.0) << "the coarse model came first";
  EXPECT_GT(psnrAt(run, 0.4), 41.0) << "the frame waits for a fade over a coarse picture";
  EXPECT_GT(psnrAt(run, 2.25), 40.0) << "after the jump";
  EXPECT_GT(psnrAt(run, 2.5), 40.0) << "nothing is worse until the last one";
  EXPECT_LT(run.rest_seconds, 2.0);
}

TEST_F(VirtualTime, framesAreAsOldAsTheLinkAndTheRendererMakeThem) {
  auto options = optionsFor({"frames"}, "1Gbit/100ms");
  const auto run = play(options).at(0);
  for (const compare::DisplayedFrame* frame : run.moving()) {
    if (frame->seconds < 0.6) continue;
    // A round trip, the renderer, the decoder; then at most one more frame in the renderer and one of the display.
    const double least = 0.1 + options.costs.server_render_seconds;
    EXPECT_GE(frame->counts.age_seconds, least);
    EXPECT_LE(frame->counts.age_seconds, least + options.costs.server_render_seconds + 0.04);
  }
  EXPECT_EQ(run.frames.back().counts.bytes, run.frames.back().counts.bytes_frames);
}

TEST_F(VirtualTime, aStaticHostEndsWithThePictureOfAServerWithoutExactFrames) {
  const auto hosted = play(optionsFor({"static"}, "20Mbit/40ms")).at(0);
  const auto served = play(optionsFor({"lumigraph"}, "20Mbit/40ms")).at(0);
  EXPECT_GT(hosted.frames.back().counts.bytes_images, 0U);
  EXPECT_EQ(hosted.frames.back().counts.bytes_frames, 0U);
  // Before its exact frame is here, the server's client shows the same images over the same patches.
  EXPECT_NEAR(hosted.meanPsnr(), served.meanPsnr(), 1.0);
  EXPECT_EQ(hosted.frames.back().counts.triangles, served.frames.back().counts.triangles);
}

TEST_F(VirtualTime, comesToTheSameRestAsOverASocket) {
  auto options = optionsFor({"patches"}, "1Gbit/1ms");
  options.path_files = {statue_.directory + "/path.json"};
  const auto path = server::makePath("orbit", statue_.scene, {160, 120, 0.1, 1});
  ASSERT_TRUE(path);
  ASSERT_TRUE(base::writeFileAtomically(options.path_files[0],
                                        base::viewOfText(base::formatCameraPath({{path->frames.front()}}))));
  const auto virtual_run = play(options).at(0);

  compare::RunOptions real;
  real.scene = statue_.directory;
  real.path = {path->frames.front()};
  real.methods = {"patches"};
  real.patch_tolerances = {virtual_run.setting.knob};
  real.report = statue_.directory + "/real";
  real.truth_supersampling = 2;
  real.pictures = false;
  const auto runs = compare::runComparison(real, [](const std::string&) {});
  ASSERT_TRUE(runs) << runs.error().message;
  const compare::FrameResult& over_socket = runs->at(0).frames.back();
  EXPECT_EQ(virtual_run.frames.back().counts.bytes_patches, over_socket.bytes_patches);
  EXPECT_NEAR(virtual_run.frames.back().accuracy.psnr_db, over_socket.accuracy.psnr_db, 0.1);
}

/// A bumpy square for hlod, and a ball for all else.
base::Result<void> makeSceneWithNodes(const std::string& directory) {
  std::filesystem::create_directories(directory);
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, support::makeScene(support::bumpySphere(20, 40, 0.1F), directory));
  const base::Bytes file = support::madeHlod().file;
  LUMIGRID_TRY(base::writeFileAtomically(directory + "/hlod.lgh", file));
  LUMIGRID_ASSIGN_OR_RETURN(const auto hash, base::sha256OfFile(directory + "/hlod.lgh"));
  scene.parts.push_back({"hlod.lgh", file.size(), hash});
  return base::writeSceneFile(scene, directory + "/scene.json");
}

TEST_F(VirtualTime, shadowsOfHlodAreJudgedByATruthThatHasThem) {
  using lod::hlod::Shadows;
  auto options = optionsFor({compare::hlodWith(Shadows::kHard), compare::hlodWith(Shadows::kSoft)}, "20Mbit/40ms");
  options.scenes = {statue_.directory + "/nodes"};
  const auto made = makeSceneWithNodes(options.scenes[0]);
  ASSERT_TRUE(made) << made.error().message;
  const auto runs = play(options);
  ASSERT_EQ(runs.size(), 2U);
  for (const PlayedRun& run : runs) {
    EXPECT_GT(run.frames.back().accuracy.psnr_db, 28.0) << run.setting.method;
    EXPECT_GE(run.rest_seconds, 0.0) << run.setting.method << " never came to rest";
  }
  EXPECT_EQ(runs[0].setting.method, "hlod-hard");
  EXPECT_EQ(runs[1].setting.method, "hlod-soft");
  EXPECT_NE(runs[0].frames.back().accuracy.psnr_db, runs[1].frames.back().accuracy.psnr_db);
  for (const std::string& name : compare::methodNames()) EXPECT_EQ(compare::shadowsOf(name), Shadows::kNone);
}

TEST_F(VirtualTime, saysWhichSceneItCannotPlay) {
  auto options = optionsFor({"patches"}, "1Gbit/1ms");
  options.scenes = {statue_.directory + "/nothing"};
  const auto runs = compare::playMatrix(options, [](const std::string&) {});
  ASSERT_FALSE(runs);
  EXPECT_NE(runs.error().message.find("nothing"), std::string::npos) << runs.error().message;
}

}  // namespace
