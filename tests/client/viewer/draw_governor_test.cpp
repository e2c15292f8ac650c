#include "client/viewer/draw_governor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

namespace client {
namespace {

constexpr double kDisplay = 1.0 / 60.0;  ///< the frame time of a fast machine, seconds
constexpr double kSlow = 0.06;           ///< a frame time beyond the budget of the usual rate

using Machine = std::function<double(const DrawEffort&)>;  ///< returns the seconds that a picture takes

/// A machine on which a picture of several samples takes `most` seconds, and any other `one`.
Machine samplesCost(double one, double most) {
  return [=](const DrawEffort& effort) { return effort.samples > 1 ? most : one; };
}

/// A machine whose time goes by samples, pixels and images.
Machine costOf(double all) {
  return [=](const DrawEffort& effort) {
    const double images = 0.5 + 0.03 * std::min(effort.points, 16);
    return all * (effort.samples > 1 ? 4.0 : 1.0) * static_cast<double>(effort.scale * effort.scale) * images;
  };
}

/// Moves the view for `seconds` of the machine's time, and returns the number of pictures with several samples.
int move(DrawGovernor& governor, double seconds, const Machine& machine) {
  int rich = 0;
  for (double time = 0.0; time < seconds;) {
    const DrawEffort effort = governor.whileMoving();
    const double frame = machine(effort);
    rich += effort.samples > 1 ? 1 : 0;
    governor.addFrame(effort, frame);
    time += frame;
  }
  return rich;
}

TEST(DrawGovernor, aFastMachineKeepsAllSamples) {
  DrawGovernor governor(4, false);
  move(governor, 100.0, samplesCost(kDisplay, kDisplay));
  EXPECT_EQ(governor.whileMoving(), (DrawEffort{4, 1.0F}));
}

TEST(DrawGovernor, slowFramesCostSamplesThenPixelsThenImages) {
  DrawGovernor governor(4, false);
  std::vector<DrawEffort> seen{governor.whileMoving()};
  for (int i = 0; i < 100; ++i) {
    governor.addFrame(governor.whileMoving(), 0.04);
    if (governor.whileMoving() != seen.back()) seen.push_back(governor.whileMoving());
  }
  EXPECT_EQ(seen, DrawGovernor::efforts(4)) << "one after the other, since each is only a little too slow";
  EXPECT_EQ(governor.mostSamples(), 4) << "which a view at rest gets";
}

TEST(DrawGovernor, eachEffortIsLessThanTheOneBefore) {
  for (const int most : {1, 4}) {
    const std::vector<DrawEffort> efforts = DrawGovernor::efforts(most);
    for (std::size_t i = 1; i < efforts.size(); ++i) {
      EXPECT_LE(efforts[i].samples, efforts[i - 1].samples);
      EXPECT_LE(efforts[i].scale, efforts[i - 1].scale);
      EXPECT_TRUE(efforts[i].samples < efforts[i - 1].samples || efforts[i].points <= efforts[i - 1].points);
      EXPECT_NE(efforts[i], efforts[i - 1]);
    }
  }
}

TEST(DrawGovernor, pausesAndSingleSlowFramesChangeNothing) {
  DrawGovernor governor(4, false);
  for (int i = 0; i < 200; ++i) governor.addFrame({4, 1.0F}, i % 2 == 0 ? kDisplay : 1.0);
  EXPECT_EQ(governor.whileMoving().samples, 4);
}

TEST(DrawGovernor, moreIsTriedAgainEverMoreSeldom) {
  DrawGovernor governor(4, false);
  const Machine machine = samplesCost(0.9 / 60.0, kSlow);
  const int first = move(governor, 100.0, machine);
  const int later = move(governor, 400.0, machine);
  EXPECT_GE(first, 20) << "tried again once at least";
  EXPECT_LE(first, 50);
  EXPECT_LE(later, 50);
  EXPECT_GE(later, 5);
}

TEST(DrawGovernor, aMachineThatBecameFastGetsEverythingBack) {
  DrawGovernor governor(4, false);
  move(governor, 2.0, samplesCost(kDisplay, kSlow));
  ASSERT_EQ(governor.whileMoving().samples, 1);
  move(governor, 8.0 * DrawGovernor::kFirstPause, costOf(0.001));
  EXPECT_EQ(governor.whileMoving(), (DrawEffort{4, 1.0F}));
}

TEST(DrawGovernor, softwareBeginsWithOneSampleAndStaysThereWhileThatIsSlowEnough) {
  DrawGovernor governor(4, true);
  const DrawEffort first = governor.whileMoving();
  EXPECT_EQ(first.samples, 1);
  EXPECT_EQ(first.scale, 1.0F);
  EXPECT_EQ(move(governor, 1000.0, samplesCost(0.03, 0.3)), 0);
  EXPECT_EQ(governor.whileMoving(), first);
}

TEST(DrawGovernor, aSlowMachineComesDownWithinAFewPictures) {
  DrawGovernor governor(4, true);
  const Machine machine = costOf(0.3);
  for (int i = 0; i < 4; ++i) governor.addFrame(governor.whileMoving(), machine(governor.whileMoving()));
  EXPECT_LT(governor.whileMoving().scale, 0.6F);
  move(governor, 60.0, machine);
  int fast = 0;
  for (int i = 0; i < 100; ++i) {
    const DrawEffort effort = governor.whileMoving();
    fast += machine(effort) <= 2.0 / DrawGovernor::kUsualRate ? 1 : 0;
    governor.addFrame(effort, machine(effort));
  }
  EXPECT_GE(fast, 90) << "of a hundred pictures";
}

TEST(DrawGovernor, aLowerRateIsMetWithMore) {
  DrawGovernor usual(4, true), lower(4, true, 5.0);
  move(usual, 60.0, costOf(0.18));
  move(lower, 60.0, costOf(0.18));
  EXPECT_LT(usual.whileMoving().scale, lower.whileMoving().scale);
}

TEST(DrawGovernor, withoutARateEachPictureHasAll) {
  DrawGovernor governor(4, true, 0.0);
  move(governor, 100.0, costOf(2.0));
  EXPECT_EQ(governor.whileMoving(), (DrawEffort{4, 1.0F}));
}

TEST(DrawGovernor, picturesOfAnotherEffortSayNothing) {
  DrawGovernor governor(4, false);
  for (int i = 0; i < 20; ++i) governor.addFrame({1, 1.0F}, kSlow);
  EXPECT_EQ(governor.whileMoving().samples, 4);
}

TEST(DrawGovernor, whereOneSampleIsWantedThereAreNeverMore) {
  DrawGovernor governor(1, false);
  EXPECT_EQ(move(governor, 100.0, costOf(0.001)), 0);
}

}  // namespace
}  // namespace client
