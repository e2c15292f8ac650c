#include "client/viewer/sample_governor.h"

#include <gtest/gtest.h>

namespace client {
namespace {

constexpr double kDisplay = 1.0 / 60.0;  ///< the frame time of a fast machine, seconds
constexpr double kSlow = 0.06;           ///< a frame time beyond the budget

/// A machine on which a picture of several samples takes `most_seconds`. Moves the view for `seconds` of its time and
/// returns the number of pictures with several samples.
int move(SampleGovernor& governor, double seconds, double one_seconds, double most_seconds) {
  int rich = 0;
  for (double time = 0.0; time < seconds;) {
    const int samples = governor.whileMoving();
    const double frame = samples > 1 ? most_seconds : one_seconds;
    rich += samples > 1 ? 1 : 0;
    governor.addFrame(samples, frame);
    time += frame;
  }
  return rich;
}

TEST(SampleGovernor, aFastMachineKeepsAllSamples) {
  SampleGovernor governor(4, false);
  move(governor, 100.0, kDisplay, kDisplay);
  EXPECT_EQ(governor.whileMoving(), 4);
}

TEST(SampleGovernor, slowFramesLeaveOneSampleAfterAFew) {
  SampleGovernor governor(4, false);
  EXPECT_EQ(move(governor, 5.0, kDisplay, kSlow), 5);
  EXPECT_EQ(governor.whileMoving(), 1);
  EXPECT_EQ(governor.most(), 4) << "which a view at rest gets";
}

TEST(SampleGovernor, pausesAndSingleSlowFramesChangeNothing) {
  SampleGovernor governor(4, false);
  for (int i = 0; i < 200; ++i) governor.addFrame(4, i % 2 == 0 ? kDisplay : 1.0);
  EXPECT_EQ(governor.whileMoving(), 4);
}

TEST(SampleGovernor, allAreTriedAgainEverMoreSeldom) {
  SampleGovernor governor(4, false);
  const int first = move(governor, 100.0, kDisplay, kSlow);
  const int later = move(governor, 400.0, kDisplay, kSlow);
  EXPECT_GE(first, 10) << "tried again once at least";
  EXPECT_LE(first, 20);
  EXPECT_LE(later, 15);
  EXPECT_GE(later, 5);
}

TEST(SampleGovernor, aMachineThatBecameFastGetsThemBack) {
  SampleGovernor governor(4, false);
  move(governor, 1.0, kDisplay, kSlow);
  ASSERT_EQ(governor.whileMoving(), 1);
  move(governor, 3.0 * SampleGovernor::kFirstPause, kDisplay, kDisplay);
  EXPECT_EQ(governor.whileMoving(), 4);
}

TEST(SampleGovernor, softwareBeginsWithOneAndStaysThereWhileThatIsSlowEnough) {
  SampleGovernor governor(4, true);
  EXPECT_EQ(governor.whileMoving(), 1);
  EXPECT_EQ(move(governor, 1000.0, 0.03, 0.3), 0);
}

TEST(SampleGovernor, picturesOfOtherSamplesSayNothing) {
  SampleGovernor governor(4, false);
  for (int i = 0; i < 20; ++i) governor.addFrame(1, kSlow);
  EXPECT_EQ(governor.whileMoving(), 4);
  SampleGovernor one(1, false);
  for (int i = 0; i < 20; ++i) one.addFrame(1, kSlow);
  EXPECT_EQ(one.whileMoving(), 1);
}

}  // namespace
}  // namespace client
