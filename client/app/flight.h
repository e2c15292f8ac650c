#pragma once
// A short eased motion from one viewpoint to another.
#include <optional>

#include "client/app/orbit_control.h"

namespace client {

class Flight {
 public:
  void begin(const Viewpoint& from, const Viewpoint& to, double now);
  bool active() const { return active_; }
  /// Returns the viewpoint at `now`. The last one is exactly `to`; then the flight is over.
  Viewpoint at(const OrbitControl& control, double now);
  void end() { active_ = false; }

 private:
  Viewpoint from_, to_;
  double begin_ = 0.0;
  bool active_ = false;
};

}  // namespace client
