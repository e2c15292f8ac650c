#include "client/app/flight.h"

#include <algorithm>

namespace client {
namespace {

// A choice: long enough for the eye to follow, short enough not to be waited for.
constexpr double kFlightSeconds = 0.45;

}  // namespace

void Flight::begin(const Viewpoint& from, const Viewpoint& to, double now) {
  from_ = from;
  to_ = to;
  begin_ = now;
  active_ = true;
}

Viewpoint Flight::at(const OrbitControl& control, double now) {
  const double t = std::clamp((now - begin_) / kFlightSeconds, 0.0, 1.0);
  if (t >= 1.0) active_ = false;
  return control.between(from_, to_, t * t * (3.0 - 2.0 * t));  // smoothstep: slow at both ends
}

}  // namespace client
