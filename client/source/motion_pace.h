#pragma once
// Decides how coarse the frames of a moving view are, by lod::qsplat::RateControl.
#include <cstdint>
#include <optional>

#include "base/camera.h"
#include "lod/qsplat/rate_control.h"

namespace client {

/// Controls a size in pixels down to which frames are refined, larger while the view moves.
class MotionPace {
 public:
  /// `frame_seconds`: of a frame of motion; 0: all frames are as fine as at rest. `finest_px`: the size at rest.
  MotionPace(double frame_seconds, float finest_px);
  void setGoal(double frame_seconds, float finest_px);

  /// Makes a frame of the same view finer than the one before. Returns whether the view has moved, or the light of its
  /// shadows, wherever that is.
  bool beginFrame(const base::Camera& camera, const glm::vec4& light = glm::vec4(0.0F));
  /// Whether the last frame was of this view and light.
  bool isLastFrame(const base::Camera& camera, const glm::vec4& light) const {
    return drawn_from_ && base::sameCamera(*drawn_from_, camera) && light == drawn_light_;
  }
  /// The size for the next frame, at least `finest_px`.
  float wantedPx(float finest_px) const;
  /// As RateControl::coarsenIfLate(), reduction() and recordFrame().
  bool coarsenIfLate(std::uint64_t count) { return isOn() && rate_.coarsenIfLate(count); }
  float reduction() const { return isOn() ? rate_.reduction() : 1.0F; }
  void recordFrame(double seconds, std::uint64_t count) { rate_.recordFrame(seconds, count); }
  bool isOn() const { return frame_seconds_ > 0.0; }

 private:
  double frame_seconds_;
  float option_px_;
  lod::qsplat::RateControl rate_;
  std::optional<base::Camera> drawn_from_;
  glm::vec4 drawn_light_{0.0F};
};

}  // namespace client
