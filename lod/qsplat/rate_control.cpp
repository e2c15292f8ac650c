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
constexpr double kMaxAreaChange = 8.0;
// A frame is not drawn when its splats are more than the last frame's time for each allows, by more than the control
// would swing: where the view leaps to the model, or all that is seen are leaves, which stay as many until the cut-off
// has passed them, each frame of feeling the way would be a late one. Traversal takes a tenth of a frame.
constexpr double kForesight = 1.3;
// Twice the splats with each step at rest.
constexpr double kRefinement = 0.70710678118654752;
constexpr float kFirstPx = 8.0F;
// Where splats lie over each other many times, larger ones cover the picture no less often: what takes time is its
// samples, which a coarser cut-off alone does not save. So a sample grows with the splats, once these are this many
// pixels wide, and time goes with 1 / area again. Finer splats on fewer samples look better than coarser ones on all of
// them; beyond eight pixels a sample there is little left to save (docs/results/qsplat.md has the figures).
constexpr double kPixelsPerSample = 6.0;
constexpr double kMaxReduction = 8.0;

void check(const RateGoal& goal) {
  LUMIGRID_CHECK(goal.frame_seconds > 0.0 && goal.finest_px > 0.0F && goal.finest_px <= goal.coarsest_px);
}

}  // namespace

RateControl::RateControl(const RateGoal& goal) : goal_(goal) {
  check(goal);
  motion_px_ = std::clamp(kFirstPx, goal.finest_px, goal.coarsest_px);
  rest_px_ = motion_px_;
}

float RateControl::reduction() const {
  const double splat_px = std::max(kPixelsPerSample, static_cast<double>(goal_.finest_px));
  return static_cast<float>(std::clamp(px() / splat_px, 1.0, kMaxReduction));
}

void RateControl::setGoal(const RateGoal& goal) {
  check(goal);
  goal_ = goal;
  most_splats_ = std::numeric_limits<double>::infinity();  // another kernel's, maybe
  for (double* px : {&motion_px_, &rest_px_})
    *px = std::clamp(*px, static_cast<double>(goal.finest_px), static_cast<double>(goal.coarsest_px));
}

bool RateControl::affords(std::uint64_t splats) {
  const double over = static_cast<double>(splats) / most_splats_;
  if (resting_ || over <= 1.0 || motion_px_ >= goal_.coarsest_px) return true;
  scaleArea(over);
  return false;
}

void RateControl::measured(double seconds, std::uint64_t splats) {
  if (!(seconds > 0.0) || !std::isfinite(seconds)) return;
  const double late = seconds / goal_.frame_seconds;
  scaleArea(std::pow(late, late > 1.0 ? kDampingLate : kDampingEarly));
  most_splats_ = kForesight * static_cast<double>(std::max<std::uint64_t>(splats, 1)) / std::min(late, kMaxAreaChange);
}

void RateControl::scaleArea(double ratio) {
  const double area = motion_px_ * motion_px_ * std::clamp(ratio, 1.0 / kMaxAreaChange, kMaxAreaChange);
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
