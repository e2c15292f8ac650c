#pragma once
// Rates for the statistics, from counts that only grow and the time that the caller brings.
#include <cstdint>
#include <deque>

namespace client {

/// How much a count grew in the last second.
class RateMeter {
 public:
  void add(double now, double count);
  /// Per second over the last second; 0 when nothing was added in it.
  double perSecond(double now) const;

 private:
  struct Entry {
    double at, count;
  };
  std::deque<Entry> entries_;
};

/// From a view's leaving to the first answer, taken only when the link was quiet before, so that the answer is not that
/// to an older view. What the server takes to plan is in it.
class RoundTripMeter {
 public:
  /// Each turn of the loop: messages received so far, views sent so far.
  void update(double now, std::uint64_t messages, std::uint64_t views);
  double seconds() const { return seconds_; }  ///< 0: not measured yet

 private:
  std::uint64_t messages_ = 0, views_ = 0;
  double last_message_ = 0.0;
  double asked_ = -1.0;  // when the view left; below 0: not waiting
  double seconds_ = 0.0;
};

}  // namespace client
