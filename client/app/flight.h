#pragma once
// A short eased way from one place to another.
#include <optional>

#include "client/app/orbit_control.h"

namespace client {

class Flight {
 public:
  void begin(const Viewpoint& from, const Viewpoint& to, double now);
  bool active() const { return active_; }
  /// Where the camera is now; the last answer is exactly `to`, and then the flight is over.
  Viewpoint at(const OrbitControl& control, double now);
  void end() { active_ = false; }

 private:
  Viewpoint from_, to_;
  double begin_ = 0.0;
  bool active_ = false;
};

}  // namespace client
