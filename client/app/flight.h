#pragma once
// A short eased motion from one viewpoint to another.
#include <algorithm>

#include "client/app/orbit_control.h"

namespace client {

class Flight {
 public:
  void begin(const Viewpoint& from, const Viewpoint& to, double now) {
    from_ = from;
    to_ = to;
    begin_ = now;
    active_ = true;
  }
  bool active() const { return active_; }
  /// Returns the viewpoint at `now`. The last one is exactly `to`; then the flight is over.
  Viewpoint at(const OrbitControl& control, double now) {
    const double t = std::clamp((now - begin_) / kSeconds, 0.0, 1.0);
    if (t >= 1.0) active_ = false;
    return control.between(from_, to_, t * t * (3.0 - 2.0 * t));  // smoothstep: slow at both ends
  }
  void end() { active_ = false; }

 private:
  // A choice: long enough for the eye to follow, short enough not to be waited for.
  static constexpr double kSeconds = 0.45;
  Viewpoint from_, to_;
  double begin_ = 0.0;
  bool active_ = false;
};

}  // namespace client
