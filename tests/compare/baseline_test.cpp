// Tests the gate: what counts as a loss against a baseline.
#include <gtest/gtest.h>

#include "compare/sim/baseline.h"

namespace {

const std::string kHead =
    "scene,method,knob,path,link,frames,bytes,mean_psnr_db,p5_psnr_db,time_to_25_s,at_rest_psnr_db,rest_s,draw_wall_"
    "ms\n";
const std::string kRun = "statue,patches,4,orbit,20Mbit/40ms,12,";
const std::string kBaseline = kHead + kRun + "1000000,25.000,20.000,1.000,30.000,0.500,9.00\n";

std::vector<std::string> lossesOf(const std::string& figures) {
  const auto losses = compare::findLosses(kHead + kRun + figures + "\n", kBaseline, "baseline.csv");
  EXPECT_TRUE(losses) << (losses ? "" : losses.error().message);
  return losses ? *losses : std::vector<std::string>{"error"};
}

TEST(Baseline, allowsNoiseGainsAndWallTime) {
  EXPECT_TRUE(lossesOf("1000000,25.000,20.000,4.000,30.000,0.500,9.00").empty());  // 25 dB come later
  EXPECT_TRUE(lossesOf("1000000,25.000,20.000,1.000,30.000,0.500,900.0").empty());
  EXPECT_TRUE(lossesOf("1019000,24.910,19.910,1.050,29.910,0.540,9.00").empty());
  EXPECT_TRUE(lossesOf("500000,35.000,30.000,0.100,40.000,0.000,9.00").empty());
}

TEST(Baseline, findsEachFigureThatGotWorse) {
  EXPECT_EQ(lossesOf("1022000,25.000,20.000,1.000,30.000,0.500,9.00").size(), 1U);
  EXPECT_EQ(lossesOf("1000000,24.890,20.000,1.000,30.000,0.500,9.00").size(), 1U);
  EXPECT_EQ(lossesOf("1000000,25.000,19.890,1.000,30.000,0.500,9.00").size(), 1U);
  EXPECT_EQ(lossesOf("1000000,25.000,20.000,1.000,29.890,0.500,9.00").size(), 1U);
  EXPECT_EQ(lossesOf("1000000,25.000,20.000,1.000,30.000,0.550,9.00").size(), 1U);
  const auto never = lossesOf("1000000,25.000,20.000,,30.000,,9.00");
  ASSERT_EQ(never.size(), 2U);
  EXPECT_NE(never[0].find("not reached"), std::string::npos) << never[0];
}

TEST(Baseline, comparesMovingFiguresAsMeansOverPaths) {
  const std::string jumps = "statue,patches,4,jumps,20Mbit/40ms,12,";
  const auto play = [&](const std::string& orbit_psnr, const std::string& jumps_psnr) {
    const std::string rest = ",20.000,1.000,30.000,0.500,9.00\n";
    return kHead + kRun + "1000000," + orbit_psnr + rest + jumps + "1000000," + jumps_psnr + rest;
  };
  const auto losses = [&](const std::string& orbit_psnr, const std::string& jumps_psnr) {
    const auto found = compare::findLosses(play(orbit_psnr, jumps_psnr), play("25.000", "27.000"), "baseline.csv");
    EXPECT_TRUE(found);
    return found ? found->size() : 99;
  };
  EXPECT_EQ(losses("24.750", "27.100"), 0U);  // 0.075 dB in the mean
  EXPECT_EQ(losses("24.750", "27.000"), 1U);
  EXPECT_EQ(losses("24.650", "27.500"), 1U);  // one path by itself
  EXPECT_EQ(losses("24.500", "26.500"), 3U);
}

TEST(Baseline, findsRunsThatOnlyOneSideHas) {
  const auto losses =
      compare::findLosses(kHead + "statue,frames,85,orbit,train,12,1,1,1,1,1,1,1\n", kBaseline, "baseline.csv");
  ASSERT_TRUE(losses);
  ASSERT_EQ(losses->size(), 2U);
  EXPECT_NE((*losses)[0].find("patches"), std::string::npos);
  EXPECT_NE((*losses)[1].find("not in the baseline"), std::string::npos);
}

TEST(Baseline, ofAnotherKindIsRefusedByName) {
  for (const std::string wrong : {"", "scene,method\n", "hello\nworld\n"}) {
    const auto refused = compare::findLosses(kBaseline, wrong, "old.csv");
    ASSERT_FALSE(refused) << wrong;
    EXPECT_EQ(refused.error().message.find("old.csv: "), 0U) << refused.error().message;
  }
}

}  // namespace
