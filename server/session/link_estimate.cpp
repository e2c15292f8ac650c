#include "server/session/link_estimate.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace server {
namespace {

// Acknowledgements come in bursts of a window, so a sample lasts a round trip at least, and this long, seconds.
constexpr double kMinSample = 0.05;
constexpr double kStall = 1.0;  // seconds without an acknowledgement after which the link counts as so slow
// A link is as fast as it was at its fastest of late: windows that still grow make samples too low. So a faster sample
// counts whole, and a slower one by half.
constexpr double kSlowerShare = 0.5;
// While messages go out without waiting, the link may be faster than was measured, and only more bytes would tell. So
// the estimate grows e-fold in a second of traffic, and before the first sample as TCP's window does at its start: by
// what is acknowledged, a round trip. It grows up to this many times the last sample, or before there is one what went
// through at the fastest; the next sample corrects it.
constexpr double kMaxGrowth = 4.0;
constexpr double kMinRate = 1e3;  // bytes a second, so that no time becomes infinite
// After so long without traffic TCP begins with a small window again (RFC 5681, section 4.1; Linux waits no less),
// seconds.
constexpr double kPause = 0.2;
constexpr double kWideWindow = 3.0;  // times what a round trip holds, from which on the link and not TCP is the limit
// Bytes that are acknowledged so much later than after a round trip waited in a queue on the way: seconds, and round
// trips.
constexpr double kLate = 0.02, kLateTrips = 0.25;

}  // namespace

void LinkEstimate::update(const LinkState& state, std::uint64_t handed_out) {
  if (state.round_trip_seconds > 0.0)
    round_trip_ = round_trip_ > 0.0 ? std::min(round_trip_, state.round_trip_seconds) : state.round_trip_seconds;
  const double waiting = static_cast<double>(state.unsent_bytes + state.unconfirmed_bytes);
  const double confirmed = std::max(confirmed_, static_cast<double>(handed_out) - waiting);

  const double passed = state.seconds - state_.seconds;
  const double arrived = confirmed - confirmed_;
  const bool was_under_way = state_.unconfirmed_bytes > 0;
  confirmed_ = confirmed;
  if (arrived > 0.0) arrived_at_ = state.seconds;
  state_ = state;
  takeSent(static_cast<double>(handed_out) - static_cast<double>(state.unsent_bytes));
  const bool late = isLate();
  // Bytes that wait in a queue on the way, not here, are no less a full link. One late packet alone is none, once the
  // rate says how many bytes fill it.
  const bool is_full = late && (!measured_ || static_cast<double>(state.unconfirmed_bytes) >= rate_ * round_trip_);
  const bool busy = state.unsent_bytes > 0 || is_full;
  growWindow(arrived, waiting <= 0.0 && !was_under_way);

  // Only time during which bytes waited tells the link's rate; else the session was the slower one. Nothing can arrive
  // in the first round trip of it, so samples begin with what arrives first.
  if (busy && was_busy_) {
    queues_ = queues_ && late;
    busy_seconds_ += passed;
    busy_bytes_ += arrived;
    if (arrives_ || arrived <= 0.0)
      takeSample(arrived > 0.0);
    else
      busy_seconds_ = busy_bytes_ = 0.0;
    arrives_ = arrives_ || arrived > 0.0;
  } else if (!busy) {
    busy_seconds_ = busy_bytes_ = 0.0;
    arrives_ = false;
    queues_ = true;
    if ((was_under_way || arrived > 0.0) && !was_busy_ && !late) growWhileIdle(passed, arrived);
  }
  was_busy_ = busy;
}

void LinkEstimate::takeSent(double sent) {
  if (sent > (sent_.empty() ? confirmed_ : sent_.back().end)) sent_.push_back({sent, state_.seconds});
  while (!sent_.empty() && sent_.front().end <= confirmed_) sent_.pop_front();
}

/// Whether the oldest bytes that are not acknowledged have been under way for longer than an idle link takes.
bool LinkEstimate::isLate() const {
  if (sent_.empty() || round_trip_ <= 0.0) return false;
  return state_.seconds - sent_.front().at > round_trip_ + std::max(kLate, kLateTrips * round_trip_);
}

/// A sample lasts from one acknowledgement to another, which can come in bursts.
void LinkEstimate::takeSample(bool arrived) {
  if (!arrived && busy_seconds_ < kStall) return;
  if (busy_seconds_ < std::max(kMinSample, round_trip_)) return;
  const double sample = std::max(kMinRate, busy_bytes_ / busy_seconds_);
  busy_seconds_ = busy_bytes_ = 0.0;
  // While TCP begins and nothing queues, its window is what was measured, and the link is as fast at least.
  const bool queued = std::exchange(queues_, true);
  if (!queued && window_ < kWideWindow * sample * round_trip_ && sample < rate_) return;
  fastest_ = sample;
  rate_ = !measured_ || sample > rate_ ? sample : rate_ + kSlowerShare * (sample - rate_);
  measured_ = true;
}

void LinkEstimate::growWhileIdle(double seconds, double arrived) {
  double grown = rate_ * std::exp(seconds);
  if (!measured_) {
    // A proxy nearby acknowledges what its buffer takes after next to no round trip.
    const double trip = std::max(kMinSample, round_trip_);
    idle_seconds_ += seconds, idle_bytes_ += arrived;
    if (idle_seconds_ >= trip) {
      fastest_ = std::max(fastest_, idle_bytes_ / idle_seconds_);
      idle_seconds_ = idle_bytes_ = 0.0;
    }
    grown = std::max(grown, rate_ + arrived / trip);
  }
  rate_ = std::min(std::max(rate_, kMaxGrowth * fastest_), grown);
}

/// A window grows by what is acknowledged until it holds more than the link does.
void LinkEstimate::growWindow(double arrived, bool idle) {
  if (state_.seconds - last_traffic_ >= std::max(kPause, round_trip_)) window_ = kFirstWindow;
  window_ += arrived;
  if (!idle) last_traffic_ = state_.seconds;
}

double LinkEstimate::waitSeconds(double bytes) const {
  if (round_trip_ <= 0.0) return 0.0;
  if (state_.unsent_bytes > 0) return (static_cast<double>(state_.unsent_bytes) + bytes) / rate_;
  const double most = std::min(window_, std::max(kFirstWindow, rate_ * round_trip_));
  const double free = std::max(0.0, most - static_cast<double>(state_.unconfirmed_bytes));
  return std::max(0.0, bytes - free) / rate_;
}

double LinkEstimate::transferSeconds(double bytes) const {
  double seconds = 0.0;
  for (double window = window_; window < bytes && window < rate_ * round_trip_; window *= 2.0) {
    bytes -= window;
    seconds += round_trip_;
  }
  return seconds + bytes / rate_;
}

/// Bytes that a round trip holds are on the way and hold nothing back; those beyond them wait in a queue somewhere.
double LinkEstimate::queueSeconds() const {
  const double on_the_way = static_cast<double>(state_.unconfirmed_bytes) / rate_ - round_trip_;
  return static_cast<double>(state_.unsent_bytes) / rate_ + std::max(0.0, on_the_way);
}

}  // namespace server
