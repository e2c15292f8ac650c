#pragma once
// Limits how often something may happen: so many times a second in the long run, and twice as many at once after a
// pause.
#include <algorithm>

namespace server {

class RateLimit {
 public:
  explicit RateLimit(double per_second) : per_second_(per_second), saved_(2.0 * per_second) {}

  /// Counts one event at `now`, seconds since any zero, which never decreases.
  void count(double now) {
    pass(now);
    saved_ -= 1.0;
  }
  /// Seconds until the next event may happen; 0: now.
  double secondsUntilNext(double now) {
    pass(now);
    return saved_ >= 1.0 ? 0.0 : (1.0 - saved_) / per_second_;
  }

 private:
  void pass(double now) {
    saved_ = std::min(2.0 * per_second_, saved_ + (now - counted_at_) * per_second_);
    counted_at_ = now;
  }

  const double per_second_;
  double saved_;  // events that may happen now
  double counted_at_ = 0.0;
};

}  // namespace server
