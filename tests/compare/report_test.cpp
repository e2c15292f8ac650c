#include "compare/report.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace {

compare::RunResult run(const std::string& method, double tolerance, std::uint64_t bytes, double psnr) {
  compare::RunResult r{method, tolerance, {}};
  for (int i = 0; i < 4; ++i) {
    compare::FrameResult f;
    f.frame = i;
    f.bytes = bytes * static_cast<std::uint64_t>(i + 1) / 4;
    f.accuracy.psnr_db = psnr;
    f.draw_ms = i;
    r.frames.push_back(f);
  }
  return r;
}

TEST(Report, interpolatesOverTheLogarithmOfBytes) {
  const auto a = run("patches", 8, 1'000'000, 20.0);
  const auto b = run("patches", 4, 4'000'000, 24.0);
  EXPECT_NEAR(compare::psnrAtBytes({&b, &a}, 2e6), 22.0, 1e-9);
  EXPECT_NEAR(compare::psnrAtBytes({&a, &b}, 1e3), 20.0, 1e-9);
  EXPECT_NEAR(compare::psnrAtBytes({&a, &b}, 1e9), 24.0, 1e-9);
}

TEST(Report, writesEveryFileAndStatesTheDifferences) {
  const support::TemporaryDirectory directory;
  const std::vector<compare::RunResult> runs{run("lumigraph", 4, 2'000'000, 27.0), run("proxy", 4, 500'000, 22.5),
                                             run("patches", 8, 1'000'000, 20.0), run("patches", 2, 4'000'000, 24.0)};
  ASSERT_TRUE(compare::writeReport(directory.path(), {"s", "m", "c", "r", 64, 48, "loopback"}, runs));
  for (const char* name :
       {"results.csv", "index.html", "accuracy_bytes.svg", "accuracy_frames.svg", "bytes_frames.svg"})
    EXPECT_TRUE(std::filesystem::exists(directory / name)) << name;
  auto page = base::readFile(directory / "index.html");
  ASSERT_TRUE(page);
  const std::string text(page->begin(), page->end());
  EXPECT_NE(text.find("+4.50 dB against the same proxy"), std::string::npos);
  EXPECT_NE(text.find("+5.00 dB against patches alone"), std::string::npos);
  auto csv = base::readFile(directory / "results.csv");
  ASSERT_TRUE(csv);
  EXPECT_EQ(std::count(csv->begin(), csv->end(), '\n'), 1 + 4 * 4);
}

}  // namespace
