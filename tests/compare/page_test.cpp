// Tests the report page: it needs no other file, and names what was played.
#include <gtest/gtest.h>

#include "compare/sim/page.h"

namespace {

compare::PlayedRun runOf(const std::string& method, double psnr_db, std::uint64_t bytes) {
  compare::PlayedRun run;
  run.scene = "statue";
  run.path = "orbit";
  run.link = "20Mbit/40ms";
  run.setting = {method, 4.0};
  for (int i = 0; i < 4; ++i) {
    compare::DisplayedFrame frame;
    frame.kind = i < 3 ? compare::InstantKind::kMoving : compare::InstantKind::kRest;
    frame.seconds = i;
    frame.accuracy.psnr_db = psnr_db + i;
    frame.counts.bytes = bytes;
    // As playPath() leaves it: the worst of the three moving frames and the median have pictures.
    if (i < 2) frame.picture_jpeg = frame.difference_jpeg = base::Bytes(10, static_cast<std::uint8_t>(i));
    run.frames.push_back(frame);
  }
  return run;
}

TEST(Page, needsNoOtherFileAndNamesTheBestAndTheSmallest) {
  const std::vector<compare::PlayedRun> runs{runOf("lumigraph", 25.0, 3'000'000), runOf("pa<tches", 20.0, 1'000'000)};
  const std::string page =
      compare::formatPage({"machine", "abc", "llvmpipe", "lumigrid-compare a & b", {}, {}, {}}, runs);
  for (const char* loaded : {"src=\"http", "href=\"http", "<link", "src=\"frames", "@import"})
    EXPECT_EQ(page.find(loaded), std::string::npos) << loaded;
  EXPECT_NE(page.find("display: <b>lumigraph 4</b>, 26.0 dB in 3.00 MB"), std::string::npos);
  EXPECT_NE(page.find("bytes: <b>pa&lt;tches 4</b>, 21.0 dB in 1.00 MB"), std::string::npos);
  EXPECT_NE(page.find("lumigrid-compare a &amp; b"), std::string::npos);
  EXPECT_EQ(page.find("pa<tches"), std::string::npos);
  // Base64 of ten zeros and of ten ones.
  EXPECT_NE(page.find("AAAAAAAAAAAAAA=="), std::string::npos);
  EXPECT_NE(page.find("AQEBAQEBAQEBAQ=="), std::string::npos);
}

TEST(Page, marksTheFrontOfBytesAndAccuracy) {
  const std::vector<compare::PlayedRun> runs{runOf("near", 25.0, 3'000'000), runOf("beaten", 19.0, 2'000'000),
                                             runOf("small", 20.0, 1'000'000)};
  const std::string page = compare::formatPage({"machine", "abc", "llvmpipe", "command", {}, {}, {}}, runs);
  for (const char* method : {"near", "small"})
    EXPECT_NE(page.find("<tr><td>" + std::string(method) + "</td><td>4</td><td>●</td>"), std::string::npos) << method;
  EXPECT_NE(page.find("<tr><td>beaten</td><td>4</td><td></td>"), std::string::npos);
}

TEST(Page, hasAChartFileOfEachKindForEachSection) {
  std::vector<compare::PlayedRun> runs{runOf("patches", 20.0, 1'000'000), runOf("lumigraph", 22.0, 2'000'000)};
  runs.push_back(runOf("patches", 21.0, 3'000'000));
  runs.back().path = "walk";
  const auto files = compare::chartFiles(runs);
  ASSERT_EQ(files.size(), 8U);
  EXPECT_EQ(files[0].name, "statue_orbit_20Mbit-40ms_bytes.svg");
  EXPECT_EQ(files[7].name, "statue_walk_20Mbit-40ms_draw_wall.svg");
  for (const auto& file : files) EXPECT_EQ(file.svg.find("<svg"), 0U) << file.name;
  EXPECT_NE(files[2].svg.find("lumigraph"), std::string::npos);
  EXPECT_EQ(files[6].svg.find("lumigraph"), std::string::npos);
}

TEST(Page, saysWhatASceneTook) {
  const std::vector<compare::PlayedRun> runs{runOf("patches", 20.0, 1'000'000)};
  const compare::SceneCosts costs{"statue", {{"images", 12'340'000, 56.7}, {"scene.json", 1000, -1.0}}, 256e6};
  const compare::SceneCosts other{"relief", {{"patch.lgp", 99'000'000, 1.0}}, 0.0};
  const std::string page = compare::formatPage({"machine", "abc", "llvmpipe", "command", {}, {}, {costs, other}}, runs);
  EXPECT_NE(page.find("<tr><td>images</td><td>12.34</td><td>56.7</td></tr>"), std::string::npos);
  EXPECT_NE(page.find("<tr><td>scene.json</td><td>0.00</td><td></td></tr>"), std::string::npos);
  EXPECT_NE(page.find("256 MB of memory"), std::string::npos);
  EXPECT_EQ(page.find("patch.lgp"), std::string::npos) << "no run is of that scene";
}

}  // namespace
