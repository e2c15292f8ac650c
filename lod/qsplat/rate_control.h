#pragma once
// How fine to draw: feedback to a frame rate while the view moves, refinement when it rests (Rusinkiewicz and Levoy
// 2000, section 2.1).
#include <cstdint>
#include <limits>

namespace lod::qsplat {

struct RateGoal {
  double frame_seconds = 0.1;  ///< that a frame of motion may take, over 0; the paper draws 5 to 10 a second
  float finest_px = 1.0F;      ///< cut-off at which a picture is as good as it gets, over 0
  float coarsest_px = 100.0F;  ///< … and beyond which nothing is to be recognised, at least finest_px
};

/// Has no clock: the caller measures. A frame at rest is one more try of the same picture, finer each time; a frame of
/// motion takes up the cut-off of the last motion.
class RateControl {
 public:
  explicit RateControl(const RateGoal& goal = {});

  /// Diameter in pixels up to which nodes are drawn as they are: for the frame that is drawn next.
  float cutoffPx() const { return static_cast<float>(px()); }
  /// By how much fewer samples a side than pixels the next frame is to be drawn with: 1 … 8; 1 at the finest cut-off.
  float reduction() const;
  /// The view moves: before the first frame of a motion.
  void move() { resting_ = false; }
  /// So many splats were found for the next frame. False: this is a frame of motion, and by what the last one took for
  /// each of its splats, it would be late; the cut-off is coarser now, for another traversal.
  bool affords(std::uint64_t splats);
  /// A frame of motion of so many splats was drawn with cutoffPx(), traversal included, in so many seconds. What is not
  /// a time above 0 changes nothing.
  void measured(double seconds, std::uint64_t splats);
  /// The view rests: the next frame is finer than the one before. False when that one was the finest.
  bool refine();

  const RateGoal& goal() const { return goal_; }
  /// Another one from now on; what was learnt of the view stays.
  void setGoal(const RateGoal& goal);

 private:
  double px() const { return resting_ ? rest_px_ : motion_px_; }
  void scaleArea(double ratio);

  RateGoal goal_;
  double motion_px_;
  double rest_px_;
  double most_splats_ = std::numeric_limits<double>::infinity();  ///< of a frame of motion that is not late
  bool resting_ = false;
};

}  // namespace lod::qsplat
