#include "client/source/motion_pace.h"

#include <algorithm>

namespace client {
namespace {

constexpr float kLeastPx = 0.1F;  // the control does not know a size of 0

lod::qsplat::RateGoal goalOf(double frame_seconds, float finest_px) {
  lod::qsplat::RateGoal goal;
  if (frame_seconds > 0.0) goal.frame_seconds = frame_seconds;
  goal.finest_px = std::max(finest_px, kLeastPx);
  goal.coarsest_px = std::max(goal.coarsest_px, goal.finest_px);
  return goal;
}

}  // namespace

MotionPace::MotionPace(double frame_seconds, float finest_px)
    : frame_seconds_(frame_seconds), option_px_(finest_px), rate_(goalOf(frame_seconds, finest_px)) {}

void MotionPace::setGoal(double frame_seconds, float finest_px) {
  frame_seconds_ = frame_seconds;
  option_px_ = finest_px;
  rate_.setGoal(goalOf(frame_seconds, finest_px));
}

bool MotionPace::beginFrame(const base::Camera& camera, const glm::vec4& light) {
  const bool moved = !isLastFrame(camera, light);
  drawn_from_ = camera;
  drawn_light_ = light;
  if (!isOn()) return moved;
  if (moved)
    rate_.beginMotion();
  else
    rate_.refineAtRest();
  return moved;
}

float MotionPace::wantedPx(float finest_px) const {
  if (!isOn()) return finest_px;
  // At its finest the control may differ from the option by rounding.
  const float wanted = rate_.cutoffPx() <= rate_.goal().finest_px ? option_px_ : rate_.cutoffPx();
  return std::max(wanted, finest_px);
}

}  // namespace client
