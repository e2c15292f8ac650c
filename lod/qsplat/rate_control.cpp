#include "lod/qsplat/rate_control.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace lod::qsplat {
namespace {

// The paper scales the square of the cut-off by actual over desired time. That is right where the time grows with the
// number of splats and this with 1 / area. Applied in full, the noise of one frame's time would show in the next
// picture, and where splats grow faster (a front that unfolds behind a crease) the control would swing. So it answers
// an early frame in part, and a late one in full, since the viewer waits. The part is a choice: more swings more, less
// takes more frames to become fine again.
constexpr double kDampingEarly = 0.6;
constexpr double kDampingLate = 1.0;
// One frame that the system held up, or the first one with a cold cache, must not make the picture useless. A choice: a
// frame that is late by more needs several steps.
constexpr double kMaxAreaChange = 8.0;
// A frame is traversed again when it has this many times the splats that fit the frame time, more than the control's
// own swing. Where the view jumps to the model, or where only leaves are seen, whose number stays the same until the
// cut-off has passed their size, every frame would be late otherwise. A traversal takes a tenth of a frame.
constexpr double kForesight = 1.3;
// Each step at rest has twice the splats. The first frame, of which nothing is known, is drawn with splats of 8 pixels,
// a choice: with finer ones it might be late.
constexpr double kRefinement = 0.70710678118654752;
constexpr float kFirstPx = 8.0F;
// Where splats overlap many times, larger ones cover the picture no less often: samples take the time, and a coarser
// cut-off does not save any. So samples grow with the splats, once those are this many pixels wide, and the time goes
// with 1 / area again. Finer splats on fewer samples look better than coarser ones on all of them; beyond eight pixels
// a sample there is little left to save (docs/results/qsplat.md has the figures).
constexpr double kPixelsPerSample = 6.0;
constexpr double kMaxReduction = 8.0;

void checkGoal(const RateGoal& goal) {
  LUMIGRID_CHECK(goal.frame_seconds > 0.0 && goal.finest_px > 0.0F && goal.finest_px <= goal.coarsest_px);
}

}  // namespace

RateControl::RateControl(const RateGoal& goal) : goal_(goal) {
  checkGoal(goal);
  motion_px_ = std::clamp(kFirstPx, goal.finest_px, goal.coarsest_px);
  rest_px_ = motion_px_;
}

void RateControl::setGoal(const RateGoal& goal) {
  checkGoal(goal);
  goal_ = goal;
  max_splats_ = std::numeric_limits<double>::infinity();  // the kernel, and so the time of a splat, may be another
  for (double* px : {&motion_px_, &rest_px_})
    *px = std::clamp(*px, static_cast<double>(goal.finest_px), static_cast<double>(goal.coarsest_px));
}

float RateControl::reduction() const {
  const double splat_px = std::max(kPixelsPerSample, static_cast<double>(goal_.finest_px));
  return static_cast<float>(std::clamp(px() / splat_px, 1.0, kMaxReduction));
}

bool RateControl::coarsenIfLate(std::uint64_t splats) {
  const double over = static_cast<double>(splats) / max_splats_;
  if (resting_ || over <= 1.0 || motion_px_ >= goal_.coarsest_px) return false;
  scaleArea(over);
  return true;
}

void RateControl::recordFrame(double seconds, std::uint64_t splats) {
  if (!(seconds > 0.0) || !std::isfinite(seconds)) return;
  const double late = seconds / goal_.frame_seconds;
  scaleArea(std::pow(late, late > 1.0 ? kDampingLate : kDampingEarly));
  max_splats_ = kForesight * static_cast<double>(std::max<std::uint64_t>(splats, 1)) / std::min(late, kMaxAreaChange);
}

bool RateControl::refineAtRest() {
  if (!resting_) rest_px_ = motion_px_;
  resting_ = true;
  if (rest_px_ <= goal_.finest_px) return false;
  rest_px_ = std::max(rest_px_ * kRefinement, static_cast<double>(goal_.finest_px));
  return true;
}

void RateControl::scaleArea(double ratio) {
  const double area = motion_px_ * motion_px_ * std::clamp(ratio, 1.0 / kMaxAreaChange, kMaxAreaChange);
  motion_px_ =
      std::clamp(std::sqrt(area), static_cast<double>(goal_.finest_px), static_cast<double>(goal_.coarsest_px));
}

}  // namespace lod::qsplat
