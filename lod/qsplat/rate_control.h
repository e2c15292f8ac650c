#pragma once
// How fine splats are drawn: a feedback to a frame rate while the view moves, refinement while it rests (Rusinkiewicz
// and Levoy 2000, section 2.1).
#include <cstdint>
#include <limits>

namespace lod::qsplat {

struct RateGoal {
  double frame_seconds = 0.1;  ///< time for a frame of motion, over 0; the paper draws 5 to 10 frames a second
  float finest_px = 1.0F;      ///< cut-off at which the picture is complete, over 0
  float coarsest_px = 100.0F;  ///< cut-off beyond which nothing can be recognised, at least finest_px
};

/// The control has no clock: the caller measures times. Each frame at rest draws the same picture again, finer; a frame
/// of motion continues with the cut-off of the last motion.
class RateControl {
 public:
  explicit RateControl(const RateGoal& goal = {});

  /// The cut-off of the next frame: projected diameter in pixels up to which nodes are drawn without their children.
  float cutoffPx() const { return static_cast<float>(px()); }
  /// Pixels a sample on each side in the next frame: 1 … 8, and 1 at the finest cut-off.
  float reduction() const;
  /// Called when the view moves, before the first frame of the motion.
  void beginMotion() { resting_ = false; }
  /// Predicts the time of a frame of motion with `splats` splats from the last frame's time for each splat. Where it
  /// would be late, the cut-off becomes coarser and the result is true: traverse again. Never at rest, nor beyond the
  /// coarsest cut-off.
  bool coarsenIfLate(std::uint64_t splats);
  /// Adjusts the cut-off to a frame of motion of `splats` splats that took `seconds`, traversal included. A number that
  /// is no time above 0 changes nothing.
  void recordFrame(double seconds, std::uint64_t splats);
  /// Makes the next frame finer than the last; called while the view rests. False when the last was the finest.
  bool refineAtRest();

  const RateGoal& goal() const { return goal_; }
  /// Changes the goal; the cut-off stays, within the new limits.
  void setGoal(const RateGoal& goal);

 private:
  double px() const { return resting_ ? rest_px_ : motion_px_; }
  void scaleArea(double ratio);

  RateGoal goal_;
  double motion_px_;
  double rest_px_;
  double max_splats_ = std::numeric_limits<double>::infinity();  ///< in a frame of motion that is not late
  bool resting_ = false;
};

}  // namespace lod::qsplat
