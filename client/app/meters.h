#pragma once
// Computes rates for the statistics from counts that only grow and the time that the caller passes.
#include <cstdint>
#include <deque>

namespace client {

/// Measures how much a count grew in the last second.
class RateMeter {
 public:
  void add(double now, double count);
  /// Returns the rate per second over the last second; 0 when nothing was added in it.
  double perSecond(double now) const;

 private:
  struct Entry {
    double at, count;
  };
  std::deque<Entry> entries_;
};

/// Measures the time from sending a view to the first answer, but only when the link was silent before, so that the
/// answer does not belong to an older view. The server's planning time is included.
class RoundTripMeter {
 public:
  /// To be called each turn of the loop, with the messages received and views sent so far.
  void update(double now, std::uint64_t messages, std::uint64_t views);
  double seconds() const { return seconds_; }  ///< 0: not measured yet

 private:
  std::uint64_t messages_ = 0, views_ = 0;
  double last_message_ = 0.0;
  double asked_ = -1.0;  // when the view was sent; below 0: no answer is awaited
  double seconds_ = 0.0;
};

}  // namespace client
