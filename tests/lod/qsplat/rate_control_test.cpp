// Tests rate control by what a viewer would see: frame times of a simulated renderer that refines a scene splat by
// splat. The control does not know how that scene's splats and covered samples depend on the cut-off.
#include "lod/qsplat/rate_control.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace lod::qsplat {
namespace {

/// A subtree of the scene as it appears in the picture.
struct Subtree {
  double root_px;  ///< projected diameter of its top node
  double leaf_px;  ///< projected diameter of its leaves
};

/// Draws a scene by refining each subtree to the cut-off, as a traversal does: a node that is too large is replaced by
/// four of half its diameter. A frame's time is a constant, plus a time for each splat, plus one for each sample that a
/// splat covers; it is measured with noise.
class SimulatedRenderer {
 public:
  explicit SimulatedRenderer(double leaf_px = 0.0) {
    std::uniform_real_distribution<double> octave(6.0, 7.0);
    std::uniform_real_distribution<double> spread(0.7, 1.4);
    for (int i = 0; i < kSubtrees; ++i) subtrees_.push_back({std::exp2(octave(random_)), leaf_px * spread(random_)});
  }

  double splat_seconds = 1e-7;
  double sample_seconds = 0.0;
  double noise = 0.05;
  std::size_t in_view = 400;  ///< subtrees; at most kSubtrees
  double zoom = 1.0;          ///< factor on all projected sizes

  static constexpr int kSubtrees = 40'000;

  std::uint64_t splats(float cutoff_px) const { return refineFrame(cutoff_px, 1.0F).splats; }
  /// Samples that splats cover at full resolution, where they are much larger than a sample.
  double coveredSamples() const { return refineFrame(50.0F, 1.0F).samples; }
  /// Returns the time of the next frame.
  double seconds(const RateControl& control) {
    const RefinedFrame drawn = refineFrame(control.cutoffPx(), control.reduction());
    std::uniform_real_distribution<double> factor(1.0 - noise, 1.0 + noise);
    return (kFrameSeconds + splat_seconds * static_cast<double>(drawn.splats) + sample_seconds * drawn.samples) *
           factor(random_);
  }

 private:
  static constexpr double kFrameSeconds = 0.004;
  struct RefinedFrame {
    std::uint64_t splats = 0;
    double samples = 0.0;
  };
  RefinedFrame refineFrame(float cutoff_px, float reduction) const {
    RefinedFrame all;
    for (std::size_t i = 0; i < in_view; ++i) {
      double size_px = zoom * subtrees_[i].root_px;
      std::uint64_t nodes = 1;
      while (size_px > static_cast<double>(cutoff_px) && size_px > zoom * subtrees_[i].leaf_px && size_px > 0.1) {
        size_px *= 0.5;
        nodes *= 4;
      }
      const double side = size_px / static_cast<double>(reduction);
      all.splats += nodes;
      all.samples += static_cast<double>(nodes) * std::max(1.0, 0.785 * side * side);
    }
    return all;
  }

  std::vector<Subtree> subtrees_;
  std::mt19937 random_{1};
};

/// Draws a frame as a viewer does, with at most three more traversals; returns its time.
double drawFrame(RateControl& control, SimulatedRenderer& renderer) {
  for (int i = 0; i < 3 && control.coarsenIfLate(renderer.splats(control.cutoffPx())); ++i) continue;
  const double seconds = renderer.seconds(control);
  control.recordFrame(seconds, renderer.splats(control.cutoffPx()));
  return seconds;
}

/// Returns the mean rate over so many frames of motion.
double rateOver(RateControl& control, SimulatedRenderer& renderer, int frames) {
  double seconds = 0.0;
  control.beginMotion();
  for (int i = 0; i < frames; ++i) seconds += drawFrame(control, renderer);
  return frames / seconds;
}

TEST(RateControlTest, pathWithStepsInLoadIsDrawnWithinATenthOfTheAskedRate) {
  for (const double asked : {5.0, 10.0, 30.0, 60.0}) {
    RateControl control({1.0 / asked, 1.0F, 100.0F});
    SimulatedRenderer renderer;
    rateOver(control, renderer, 10);
    double seconds = 0.0;
    int frames = 0;
    for (const std::size_t in_view : {800U, 2400U, 600U, 2000U, 4000U, 1000U}) {
      renderer.in_view = in_view;
      seconds += 30 / rateOver(control, renderer, 30);
      frames += 30;
    }
    EXPECT_NEAR(frames / seconds, asked, 0.1 * asked);
  }
}

TEST(RateControlTest, fiveFramesAfterAStepInLoadTheRateIsWithinATenth) {
  for (const std::size_t in_view : {200U, 400U, 1600U, 3200U}) {
    RateControl control({0.1, 1.0F, 100.0F});
    SimulatedRenderer renderer;
    renderer.in_view = 800;
    rateOver(control, renderer, 20);
    renderer.in_view = in_view;
    rateOver(control, renderer, 5);
    EXPECT_NEAR(rateOver(control, renderer, 20), 10.0, 1.0) << in_view << " subtrees in place of 800";
  }
}

TEST(RateControlTest, fiveFramesAfterAZoomTheRateIsWithinATenth) {
  for (const double zoom : {0.5, 0.7, 1.5, 3.0}) {
    RateControl control({0.1, 1.0F, 100.0F});
    SimulatedRenderer renderer;
    renderer.in_view = 800;
    rateOver(control, renderer, 20);
    renderer.zoom = zoom;
    rateOver(control, renderer, 5);
    EXPECT_NEAR(rateOver(control, renderer, 20), 10.0, 1.0) << "zoomed by " << zoom;
  }
}

TEST(RateControlTest, noFrameIsFarTooLateWhenMoreComesIntoView) {
  for (const std::size_t factor : {2U, 10U, 100U}) {
    RateControl control({0.1, 1.0F, 100.0F});
    SimulatedRenderer renderer;
    rateOver(control, renderer, 20);
    renderer.in_view *= factor;
    for (int i = 0; i < 5; ++i) EXPECT_LT(drawFrame(control, renderer), 0.15) << "a load of " << factor;
    EXPECT_GT(rateOver(control, renderer, 5), 8.0) << "nor far too coarse";
  }
}

// Seen from within a model all splats are leaves at first; a coarser cut-off changes nothing until it has passed their
// size.
TEST(RateControlTest, leavesLargerThanTheCutOffMakeFewFramesLate) {
  RateControl control({0.1, 1.0F, 100.0F});
  SimulatedRenderer renderer(6.0);
  renderer.in_view = 300;
  rateOver(control, renderer, 30);
  ASSERT_EQ(control.cutoffPx(), 1.0F);
  renderer.in_view = 20'000;
  int late = 0;
  for (int i = 0; i < 20; ++i) late += drawFrame(control, renderer) > 0.15 ? 1 : 0;
  EXPECT_LE(late, 2);
  EXPECT_NEAR(rateOver(control, renderer, 20), 10.0, 1.0);
}

TEST(RateControlTest, atRestAnyNumberOfSplatsIsDrawn) {
  RateControl control({0.1, 1.0F, 100.0F});
  SimulatedRenderer renderer;
  rateOver(control, renderer, 20);
  const float moving = control.cutoffPx();
  EXPECT_TRUE(control.coarsenIfLate(100'000'000));
  EXPECT_GT(control.cutoffPx(), moving);
  while (control.refineAtRest()) {
    const float before = control.cutoffPx();
    EXPECT_FALSE(control.coarsenIfLate(100'000'000));
    EXPECT_EQ(control.cutoffPx(), before);
  }
  control.beginMotion();
  for (int i = 0; control.coarsenIfLate(100'000'000); ++i) ASSERT_LT(i, 10) << "it must end at the coarsest";
}

// A front that unfolds behind a crease: time goes with the inverse area to the power 1.4.
TEST(RateControlTest, loadThatGrowsFasterThanTheAreaDoesNotSwing) {
  RateControl control({0.1, 1.0F, 100.0F});
  control.beginMotion();
  for (int i = 0; i < 60; ++i) {
    const double seconds = 0.3 * std::pow(10.0 / static_cast<double>(control.cutoffPx()), 2.8);
    if (i >= 20) {
      EXPECT_NEAR(seconds, 0.1, 0.01) << i;
    }
    control.recordFrame(seconds, 1000);
  }
}

// From within a model, splats cover the picture many times however coarse they are, and all time goes into samples.
TEST(RateControlTest, whereSamplesTakeMostTimeTheRateIsReachedWithFewerOfThem) {
  for (const double asked : {5.0, 10.0, 30.0}) {
    RateControl control({1.0 / asked, 1.0F, 100.0F});
    SimulatedRenderer renderer;
    const double covered = renderer.coveredSamples();
    double seconds = 0.0;
    int frames = 0;
    for (const double frames_of_time : {0.5, 3.0, 10.0, 1.2, 0.0, 6.0}) {
      renderer.sample_seconds = frames_of_time / asked / covered;
      rateOver(control, renderer, 10);
      const double rate = rateOver(control, renderer, 30);
      EXPECT_NEAR(rate, asked, 0.1 * asked) << "samples take " << frames_of_time << " frames' time";
      if (frames_of_time >= 3.0) {
        EXPECT_GT(control.reduction(), 1.2F);
      }
      seconds += 30.0 / rate;
      frames += 30;
    }
    EXPECT_NEAR(frames / seconds, asked, 0.05 * asked);
  }
}

TEST(RateControlTest, steadyLoadIsDrawnWithASteadyReduction) {
  for (double sample_seconds = 1e-8; sample_seconds < 3e-7; sample_seconds *= 1.3) {
    RateControl control({0.1, 1.0F, 100.0F});
    SimulatedRenderer renderer;
    renderer.noise = 0.0;
    renderer.sample_seconds = sample_seconds;
    rateOver(control, renderer, 60);
    const float before = control.reduction();
    rateOver(control, renderer, 1);
    EXPECT_NEAR(control.reduction(), before, 0.05F * before) << sample_seconds << " s a sample";
    // With noisy times the reduction stays nearly the same.
    renderer.noise = 0.15;
    float least = before, largest = before;
    for (int i = 0; i < 60; ++i) {
      rateOver(control, renderer, 1);
      least = std::min(least, control.reduction());
      largest = std::max(largest, control.reduction());
    }
    EXPECT_LT(largest, 1.5F * least) << sample_seconds << " s a sample";
  }
}

TEST(RateControlTest, reductionNeedsCoarseSplatsAndEndsAtTheFinest) {
  for (const float finest : {0.5F, 1.0F, 30.0F}) {
    RateControl control({0.1, finest, 100.0F});
    SimulatedRenderer renderer;
    renderer.sample_seconds = 3e-7;
    rateOver(control, renderer, 40);
    if (finest < 10.0F) {
      EXPECT_GT(control.reduction(), 1.5F);
    }
    float before = control.reduction();
    EXPECT_LE(before, 8.0F);
    while (control.refineAtRest()) {
      EXPECT_LE(control.reduction(), before);
      before = control.reduction();
    }
    EXPECT_EQ(control.reduction(), 1.0F);
  }
  // All time goes into splats, none into samples: no reduction.
  RateControl control({0.1, 1.0F, 100.0F});
  SimulatedRenderer renderer;
  rateOver(control, renderer, 20);
  ASSERT_LT(control.cutoffPx(), 6.0F);
  EXPECT_EQ(control.reduction(), 1.0F);
  control.recordFrame(1e9, 1000);
  for (int i = 0; i < 20; ++i) control.recordFrame(10.0, 1000);
  EXPECT_EQ(control.reduction(), 8.0F) << "at the coarsest";
}

TEST(RateControlTest, fastSceneIsDrawnAtItsFinest) {
  RateControl control({0.1, 1.0F, 100.0F});
  SimulatedRenderer renderer(8.0);
  renderer.in_view = 400;
  rateOver(control, renderer, 30);
  EXPECT_EQ(control.cutoffPx(), 1.0F);
  // The control recovers when the scene is not fast any more.
  renderer.in_view = 30'000;
  rateOver(control, renderer, 6);
  EXPECT_NEAR(rateOver(control, renderer, 20), 10.0, 1.0);
}

TEST(RateControlTest, sceneThatIsNeverFastEnoughStaysAtTheCoarsest) {
  RateControl control({0.001, 1.0F, 40.0F});
  SimulatedRenderer renderer;
  rateOver(control, renderer, 40);
  EXPECT_EQ(control.cutoffPx(), 40.0F);
}

TEST(RateControlTest, restRefinesDownToTheFinestAndMotionReturnsToItsCutOff) {
  RateControl control({0.1, 1.0F, 100.0F});
  SimulatedRenderer renderer;
  renderer.in_view = 2000;
  rateOver(control, renderer, 20);
  const float moving = control.cutoffPx();
  ASSERT_GT(moving, 2.0F);
  float before = moving;
  int steps = 0;
  while (control.refineAtRest()) {
    EXPECT_LT(control.cutoffPx(), before);
    before = control.cutoffPx();
    ASSERT_LT(++steps, 20);
  }
  EXPECT_EQ(control.cutoffPx(), 1.0F);
  EXPECT_FALSE(control.refineAtRest());
  control.beginMotion();
  EXPECT_EQ(control.cutoffPx(), moving);
}

TEST(RateControlTest, newGoalIsReached) {
  SimulatedRenderer renderer;
  RateControl control({0.2, 1.0F, 100.0F});
  rateOver(control, renderer, 30);
  control.setGoal({0.05, 1.0F, 100.0F});
  rateOver(control, renderer, 15);
  EXPECT_NEAR(rateOver(control, renderer, 30), 20.0, 2.0);
  control.setGoal({0.05, 30.0F, 100.0F});
  EXPECT_EQ(control.cutoffPx(), 30.0F) << "no finer than it may be";
  EXPECT_TRUE(!control.refineAtRest() && control.cutoffPx() == 30.0F);
}

TEST(RateControlTest, numbersThatAreNoTimeChangeNothing) {
  RateControl control({0.1, 1.0F, 100.0F});
  const float before = control.cutoffPx();
  for (const double odd : {0.0, -1.0, std::nan(""), static_cast<double>(INFINITY)}) control.recordFrame(odd, 1000);
  EXPECT_EQ(control.cutoffPx(), before);
}

TEST(RateControlTest, frameThatTheSystemHeldUpCoarsensThePictureLittle) {
  RateControl control({0.1, 1.0F, 100.0F});
  SimulatedRenderer renderer;
  rateOver(control, renderer, 20);
  const float before = control.cutoffPx();
  control.recordFrame(60.0, renderer.splats(before));
  EXPECT_LT(control.cutoffPx(), 3.0F * before);
}

}  // namespace
}  // namespace lod::qsplat
