#pragma once
// The motion of a client's eye, from the views that it sent and the times at which they arrived.
#include <list>

#include "base/camera.h"

namespace server {

class Motion {
 public:
  /// `reach`: world units that the eye moves between two views at most; a longer step is a jump.
  explicit Motion(double reach = 0.0) : reach_(reach) {}
  /// Accepts the newest view, which arrived at `seconds`. Returns false when it begins anew: after a jump, a pause or
  /// with another size or angle.
  bool accept(const base::ViewCamera& camera, double seconds);
  /// Whether the eye moves: two views at least came in quick succession and differ, and the last of them is recent.
  bool moving(double now) const;
  /// When moving() ends if no other view arrives, seconds; call it while the eye moves.
  double settledAt() const;
  /// Returns the newest view moved on for so many seconds at the speed of the last views, at most kMaxAhead. Call it
  /// while the eye moves.
  base::ViewCamera ahead(double seconds) const;
  /// When the newest view arrived.
  double newestAt() const { return views_.empty() ? 0.0 : views_.back().seconds; }

  static constexpr double kMaxAhead = 0.4;

 private:
  struct Timed {
    base::ViewCamera camera;
    double seconds;
  };
  bool follows(const base::ViewCamera& camera, double seconds) const;

  double reach_;
  std::list<Timed> views_;  // of one motion, oldest first
};

}  // namespace server
