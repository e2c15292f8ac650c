#include "lod/qsplat/rate_control.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace lod::qsplat {
namespace {

/// A renderer as they are: something for each frame, something for each splat, something for each sample that they
/// cover, and no more splats than there are leaves; measured with noise.
struct ModelledRenderer {
  double frame_seconds = 0.004;
  double splat_seconds = 1e-7;
  double splats_at_one_px = 8e6;  // the load: how much of the model is in view
  double leaves = 4e6;
  double cover_seconds = 0.0;  // all samples of the picture, as many times over as splats lie there at any cut-off
  double noise = 0.05;
  std::mt19937 random{1};

  std::uint64_t splats(float cutoff_px) const {
    return static_cast<std::uint64_t>(
        std::min(leaves, splats_at_one_px / std::pow(static_cast<double>(cutoff_px), 2.0)));
  }
  double seconds(const RateControl& control) {
    const double covering = cover_seconds / std::pow(static_cast<double>(control.reduction()), 2.0);
    std::uniform_real_distribution<double> factor(1.0 - noise, 1.0 + noise);
    return (frame_seconds + splat_seconds * static_cast<double>(splats(control.cutoffPx())) + covering) *
           factor(random);
  }
};

// A frame as a viewer draws it: traversal again where there are too many splats, but not for ever.
double drawnIn(RateControl& control, ModelledRenderer& renderer) {
  for (int i = 0; i < 3 && !control.affords(renderer.splats(control.cutoffPx())); ++i) continue;
  const double seconds = renderer.seconds(control);
  control.measured(seconds, renderer.splats(control.cutoffPx()));
  return seconds;
}

// Mean rate over so many frames of motion.
double rateOver(RateControl& control, ModelledRenderer& renderer, int frames) {
  double seconds = 0.0;
  control.move();
  for (int i = 0; i < frames; ++i) seconds += drawnIn(control, renderer);
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

TEST(RateControlTest, whereMoreSplatsComeIntoViewNoFrameIsFarTooLate) {
  for (const double factor : {2.0, 10.0, 100.0}) {
    RateControl control({0.1, 1.0F, 100.0F});
    ModelledRenderer renderer;
    rateOver(control, renderer, 20);
    renderer.splats_at_one_px *= factor;
    renderer.leaves = 1e9;
    for (int i = 0; i < 5; ++i) EXPECT_LT(drawnIn(control, renderer), 0.15) << "a load of " << factor;
    EXPECT_GT(rateOver(control, renderer, 5), 8.0) << "nor far too coarse";
  }
}

// Seen from within, all splats are leaves at first, which a coarser cut-off leaves as they are until it has passed
// them.
TEST(RateControlTest, leavesThatAllAreLargerThanTheCutOffMakeFewFramesLate) {
  RateControl control({0.1, 1.0F, 100.0F});
  ModelledRenderer renderer;
  renderer.leaves = 2e5;
  rateOver(control, renderer, 30);
  ASSERT_EQ(control.cutoffPx(), 1.0F);
  renderer.leaves = 4e6;
  renderer.splats_at_one_px = 4e6 * 36.0;  // fewer from 6 pixels on
  int late = 0;
  for (int i = 0; i < 20; ++i) late += drawnIn(control, renderer) > 0.15 ? 1 : 0;
  EXPECT_LE(late, 2);
  EXPECT_NEAR(rateOver(control, renderer, 20), 10.0, 1.0);
}

TEST(RateControlTest, atRestAnyNumberOfSplatsIsDrawn) {
  RateControl control({0.1, 1.0F, 100.0F});
  ModelledRenderer renderer;
  rateOver(control, renderer, 20);
  const float moving = control.cutoffPx();
  EXPECT_FALSE(control.affords(100'000'000));
  EXPECT_GT(control.cutoffPx(), moving);
  while (control.refine()) {
    const float before = control.cutoffPx();
    EXPECT_TRUE(control.affords(100'000'000));
    EXPECT_EQ(control.cutoffPx(), before);
  }
  control.move();
  for (int i = 0; !control.affords(100'000'000); ++i) ASSERT_LT(i, 10) << "it ends at the coarsest";
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
    control.measured(seconds, 1000);
  }
}

// From within a model splats cover the picture many times, however coarse they are.
TEST(RateControlTest, whereSamplesTakeAllTheTimeAndMoreTheRateIsReachedWithFewerOfThem) {
  for (const double asked : {5.0, 10.0, 30.0}) {
    RateControl control({1.0 / asked, 1.0F, 100.0F});
    ModelledRenderer renderer;
    double seconds = 0.0;
    int frames = 0;
    for (const double cover : {0.5, 3.0, 10.0, 1.2, 0.0, 6.0}) {
      renderer.cover_seconds = cover / asked;
      rateOver(control, renderer, 10);
      const double rate = rateOver(control, renderer, 30);
      EXPECT_NEAR(rate, asked, 0.1 * asked) << cover << " frames' time for all samples once";
      EXPECT_LT(control.cutoffPx(), 50.0F);
      if (cover >= 1.0) {
        EXPECT_GT(control.reduction(), 0.9F * static_cast<float>(std::sqrt(cover)));
      }
      seconds += 30.0 / rate;
      frames += 30;
    }
    EXPECT_NEAR(frames / seconds, asked, 0.05 * asked);
  }
}

TEST(RateControlTest, aLoadThatStaysIsDrawnWithSamplesThatStay) {
  for (double cover = 0.02; cover < 3.0; cover *= 1.1) {
    RateControl control({0.1, 1.0F, 100.0F});
    ModelledRenderer renderer;
    renderer.noise = 0.0;
    renderer.cover_seconds = cover;
    rateOver(control, renderer, 60);
    const float before = control.reduction();
    rateOver(control, renderer, 1);
    EXPECT_NEAR(control.reduction(), before, 1e-3F * before) << cover << " s for all samples once";
    // And nearly so where times are not to be trusted.
    renderer.noise = 0.15;
    float least = before, most = before;
    for (int i = 0; i < 60; ++i) {
      rateOver(control, renderer, 1);
      least = std::min(least, control.reduction());
      most = std::max(most, control.reduction());
    }
    EXPECT_LT(most, 1.5F * least) << cover << " s for all samples once";
  }
}

TEST(RateControlTest, samplesAreLessThanPixelsOnlyWhereSplatsAreCoarseAndNeverAtTheFinest) {
  for (const float finest : {0.5F, 1.0F, 30.0F}) {
    RateControl control({0.1, finest, 100.0F});
    ModelledRenderer renderer;
    renderer.cover_seconds = 0.8;
    rateOver(control, renderer, 40);
    if (finest < 10.0F) {
      EXPECT_GT(control.reduction(), 1.5F);
    }
    float before = control.reduction();
    EXPECT_LE(before, 8.0F);
    while (control.refine()) {
      EXPECT_LE(control.reduction(), before);
      before = control.reduction();
    }
    EXPECT_EQ(control.reduction(), 1.0F);
  }
  // Time for splats, none for samples.
  RateControl control({0.1, 1.0F, 100.0F});
  ModelledRenderer renderer;
  rateOver(control, renderer, 20);
  ASSERT_LT(control.cutoffPx(), 4.0F);
  EXPECT_EQ(control.reduction(), 1.0F);
  control.measured(1e9, 1000);
  for (int i = 0; i < 20; ++i) control.measured(10.0, 1000);
  EXPECT_EQ(control.reduction(), 8.0F) << "at the coarsest";
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
  for (const double odd : {0.0, -1.0, std::nan(""), static_cast<double>(INFINITY)}) control.measured(odd, 1000);
  EXPECT_EQ(control.cutoffPx(), before);
}

TEST(RateControlTest, aFrameThatTheSystemHeldUpDoesNotThrowThePictureAway) {
  RateControl control({0.1, 1.0F, 100.0F});
  ModelledRenderer renderer;
  rateOver(control, renderer, 20);
  const float before = control.cutoffPx();
  control.measured(60.0, renderer.splats(before));
  EXPECT_LT(control.cutoffPx(), 3.0F * before);
}

}  // namespace
}  // namespace lod::qsplat
