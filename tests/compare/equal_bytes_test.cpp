// Tests the comparison of methods at equal bytes.
#include "compare/sim/equal_bytes.h"

#include <gtest/gtest.h>

namespace {

compare::PlayedRun runOf(const std::string& method, double knob, std::uint64_t bytes, const std::vector<double>& psnr) {
  compare::PlayedRun run;
  run.setting = {method, knob};
  for (const double db : psnr) {
    compare::DisplayedFrame frame;
    frame.accuracy.psnr_db = db;
    frame.counts.bytes = bytes;
    run.frames.push_back(frame);
  }
  return run;
}

TEST(EqualBytes, interpolatesOverTheLogarithmFrameByFrame) {
  // Halfway between 1 and 4 MB over the logarithm is 2 MB: the coarse run and the fine one count half each.
  const auto reference = runOf("lumigraph", 4, 2'000'000, {30.0, 32.0, 31.0});
  const auto coarse = runOf("patches", 8, 1'000'000, {20.0, 20.0, 20.0});
  const auto fine = runOf("patches", 1, 4'000'000, {30.0, 30.0, 30.0});
  const auto coarser = runOf("patches", 16, 500'000, {1.0, 1.0, 1.0});
  const auto found = compare::differencesAtBytesOf(reference, {&reference, &coarse, &fine, &coarser});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].method, "patches");
  EXPECT_NEAR(found[0].db, 6.0, 1e-9);
  // 5, 7, 6: a deviation of 1; t with two degrees of freedom is 4.303.
  EXPECT_NEAR(found[0].confidence, 4.303 / std::sqrt(3.0), 1e-9);
}

TEST(EqualBytes, leavesOutMethodsThatDoNotReachTheBytes) {
  const auto reference = runOf("lumigraph", 4, 2'000'000, {30.0, 32.0});
  const auto small = runOf("patches", 8, 1'000'000, {20.0, 20.0});
  const auto smaller = runOf("patches", 16, 500'000, {10.0, 10.0});
  EXPECT_TRUE(compare::differencesAtBytesOf(reference, {&reference, &small, &smaller}).empty());
  EXPECT_TRUE(compare::differencesAtBytesOf(reference, {&reference}).empty());
}

}  // namespace
