#include "lod/qsplat/rate_control.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace lod::qsplat {
namespace {

/// A renderer as they are: something for each frame, something for each splat, and no more splats than there are
/// leaves; measured with noise.
struct ModelledRenderer {
  double frame_seconds = 0.004;
  double splat_seconds = 1e-7;
  double splats_at_one_px = 8e6;  // the load: how much of the model is in view
  double leaves = 4e6;
  double noise = 0.05;
  std::mt19937 random{1};

  double seconds(float cutoff_px) {
    const double splats = std::min(leaves, splats_at_one_px / std::pow(static_cast<double>(cutoff_px), 2.0));
    std::uniform_real_distribution<double> factor(1.0 - noise, 1.0 + noise);
    return (frame_seconds + splat_seconds * splats) * factor(random);
  }
};

// Mean rate over so many frames of motion.
double rateOver(RateControl& control, ModelledRenderer& renderer, int frames) {
  double seconds = 0.0;
  control.move();
  for (int i = 0; i < frames; ++i) {
    const double taken = renderer.seconds(control.cutoffPx());
    control.measured(taken);
    seconds += taken;
  }
  return frames / seconds;
}

TEST(RateControlTest, aPathWithStepsInLoadIsDrawnWithinATenthOfTheAskedRate) {
  for (const double asked : {5.0, 10.0, 30.0, 60.0}) {
    RateControl control({1.0 / asked, 1.0F, 100.0F});
    ModelledRenderer renderer;
    rateOver(control, renderer, 10);
    double seconds = 0.0;
    int frames = 0;
    for (const double load : {8e6, 24e6, 6e6, 20e6, 40e6, 10e6}) {
      renderer.splats_at_one_px = load;
      seconds += 30 / rateOver(control, renderer, 30);
      frames += 30;
    }
    EXPECT_NEAR(frames / seconds, asked, 0.1 * asked);
  }
}

TEST(RateControlTest, fiveFramesAfterAStepTheRateIsWithinATenth) {
  for (const double factor : {0.25, 0.5, 2.0, 4.0}) {
    RateControl control({0.1, 1.0F, 100.0F});
    ModelledRenderer renderer;
    rateOver(control, renderer, 20);
    renderer.splats_at_one_px *= factor;
    rateOver(control, renderer, 5);
    EXPECT_NEAR(rateOver(control, renderer, 20), 10.0, 1.0) << "after a load of " << factor;
  }
}

TEST(RateControlTest, aLoadThatGrowsFasterThanTheAreaDoesNotSwing) {
  RateControl control({0.1, 1.0F, 100.0F});
  control.move();
  for (int i = 0; i < 60; ++i) {
    // Time with the inverse area to the power 1.4.
    const double seconds = 0.3 * std::pow(10.0 / static_cast<double>(control.cutoffPx()), 2.8);
    if (i >= 20) {
      EXPECT_NEAR(seconds, 0.1, 0.01) << i;
    }
    control.measured(seconds);
  }
}

TEST(RateControlTest, whatIsFastEnoughIsDrawnAtItsFinest) {
  RateControl control({0.1, 1.0F, 100.0F});
  ModelledRenderer renderer;
  renderer.leaves = 1e5;
  rateOver(control, renderer, 30);
  EXPECT_EQ(control.cutoffPx(), 1.0F);
  // And comes back at once when it is not any more.
  renderer.leaves = 4e6;
  rateOver(control, renderer, 6);
  EXPECT_NEAR(rateOver(control, renderer, 20), 10.0, 1.0);
}

TEST(RateControlTest, whatIsNeverFastEnoughStaysAtTheCoarsest) {
  RateControl control({0.001, 1.0F, 40.0F});
  ModelledRenderer renderer;
  rateOver(control, renderer, 40);
  EXPECT_EQ(control.cutoffPx(), 40.0F);
}

TEST(RateControlTest, restRefinesWithoutABackwardStepDownToTheFinestAndMotionTakesUpItsOwn) {
  RateControl control({0.1, 1.0F, 100.0F});
  ModelledRenderer renderer;
  rateOver(control, renderer, 20);
  const float moving = control.cutoffPx();
  ASSERT_GT(moving, 2.0F);
  float before = moving;
  int steps = 0;
  while (control.refine()) {
    EXPECT_LT(control.cutoffPx(), before);
    before = control.cutoffPx();
    ASSERT_LT(++steps, 20);
  }
  EXPECT_EQ(control.cutoffPx(), 1.0F);
  EXPECT_FALSE(control.refine());
  control.move();
  EXPECT_EQ(control.cutoffPx(), moving);
}

TEST(RateControlTest, anotherGoalIsMetFromThereOn) {
  ModelledRenderer renderer;
  RateControl control({0.2, 1.0F, 100.0F});
  rateOver(control, renderer, 30);
  control.setGoal({0.05, 1.0F, 100.0F});
  rateOver(control, renderer, 15);
  EXPECT_NEAR(rateOver(control, renderer, 30), 20.0, 2.0);
  control.setGoal({0.05, 30.0F, 100.0F});
  EXPECT_EQ(control.cutoffPx(), 30.0F) << "no finer than it may be";
  EXPECT_TRUE(!control.refine() && control.cutoffPx() == 30.0F);
}

TEST(RateControlTest, whatIsNoTimeChangesNothing) {
  RateControl control({0.1, 1.0F, 100.0F});
  const float before = control.cutoffPx();
  for (const double odd : {0.0, -1.0, std::nan(""), static_cast<double>(INFINITY)}) control.measured(odd);
  EXPECT_EQ(control.cutoffPx(), before);
}

TEST(RateControlTest, aFrameThatTheSystemHeldUpDoesNotThrowThePictureAway) {
  RateControl control({0.1, 1.0F, 100.0F});
  ModelledRenderer renderer;
  rateOver(control, renderer, 20);
  const float before = control.cutoffPx();
  control.measured(60.0);
  EXPECT_LT(control.cutoffPx(), 3.0F * before);
}

}  // namespace
}  // namespace lod::qsplat
