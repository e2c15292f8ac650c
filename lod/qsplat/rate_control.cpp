#include "lod/qsplat/rate_control.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace lod::qsplat {
namespace {

// The paper scales the threshold's area by actual over desired time, which is right where time goes with the number of
// splats and these with 1 / area. Taken by its whole, noise in one frame's time shows in the next frame's picture, and
// where splats grow faster than that (a front that unfolds behind a crease) it swings. So a frame that came early is
// answered in part; one that came late by its whole, since the viewer waits.
constexpr double kDampingEarly = 0.6;
constexpr double kDampingLate = 1.0;
// One frame that the system held up, or the first with a cold cache, must not throw the picture away.
constexpr double kMostAreaChange = 8.0;
// Twice the splats with each step at rest.
constexpr double kRefinement = 0.70710678118654752;
constexpr float kFirstPx = 8.0F;

void check(const RateGoal& goal) {
  LUMIGRID_CHECK(goal.frame_seconds > 0.0 && goal.finest_px > 0.0F && goal.finest_px <= goal.coarsest_px);
}

}  // namespace

RateControl::RateControl(const RateGoal& goal) : goal_(goal) {
  check(goal);
  motion_px_ = std::clamp(kFirstPx, goal.finest_px, goal.coarsest_px);
  rest_px_ = motion_px_;
}

void RateControl::setGoal(const RateGoal& goal) {
  check(goal);
  goal_ = goal;
  for (double* px : {&motion_px_, &rest_px_})
    *px = std::clamp(*px, static_cast<double>(goal.finest_px), static_cast<double>(goal.coarsest_px));
}

void RateControl::measured(double seconds) {
  if (!(seconds > 0.0) || !std::isfinite(seconds)) return;
  const double late = seconds / goal_.frame_seconds;
  const double ratio = std::pow(late, late > 1.0 ? kDampingLate : kDampingEarly);
  const double area = motion_px_ * motion_px_ * std::clamp(ratio, 1.0 / kMostAreaChange, kMostAreaChange);
  motion_px_ =
      std::clamp(std::sqrt(area), static_cast<double>(goal_.finest_px), static_cast<double>(goal_.coarsest_px));
}

bool RateControl::refine() {
  if (!resting_) rest_px_ = motion_px_;
  resting_ = true;
  if (rest_px_ <= goal_.finest_px) return false;
  rest_px_ = std::max(rest_px_ * kRefinement, static_cast<double>(goal_.finest_px));
  return true;
}

}  // namespace lod::qsplat
