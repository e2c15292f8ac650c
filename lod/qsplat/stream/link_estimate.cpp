#include "lod/qsplat/stream/link_estimate.h"

#include <algorithm>
#include <cmath>

namespace lod::qsplat {
namespace {

// After this many busy seconds a measurement counts half. A choice: a shorter time follows a changing link sooner, and
// its noise as well.
constexpr double kHalfLife = 1.0;
// Seconds of traffic that are under way beyond a round trip's: as long as a slow frame delays the next requests.
constexpr double kAheadSeconds = 0.25;
// The least is enough to measure an unknown link, and to use links so slow that a block takes long. The most, a choice,
// bounds what comes too late after a view has changed.
constexpr double kMinRoom = 8.0 * 1024.0;
constexpr double kMaxRoom = 2.0 * 1024.0 * 1024.0;
// The shortest round trip seen grows by this factor with each answer, since links change. It may then come to contain
// the time that our own requests queue, so kMaxAhead bounds it.
// The factor is a choice: it doubles the value in 347 answers.
constexpr double kForget = 1.002;
constexpr double kMaxAhead = 0.7;  // seconds
// A request may ask for one part in so many of what may be under way, so that several overlap. None is sent until that
// much is free: the HTTP heads of small answers would fill the link.
constexpr std::uint64_t kRequestsAtOnce = 4;

}  // namespace

void LinkEstimate::recordRequest(std::uint64_t bytes, double now) {
  if (under_way_ == 0) last_ = now;
  under_way_ += bytes;
}

void LinkEstimate::recordAnswer(std::uint64_t asked, std::uint64_t bytes, double sent_at, double now) {
  under_way_ -= std::min(asked, under_way_);
  const double busy = std::max(now - last_, 0.0);
  last_ = now;
  const double keep = std::exp2(-busy / kHalfLife);
  bytes_ = bytes_ * keep + static_cast<double>(bytes);
  seconds_ = seconds_ * keep + busy;
  if (bytes == 0) return;
  const double trip = std::max(now - sent_at, 0.0);
  round_trip_ = round_trip_ < 0.0 ? trip : std::min(trip, kForget * round_trip_);
}

double LinkEstimate::bytesPerSecond() const {
  return seconds_ > 0.0 ? bytes_ / seconds_ : 0.0;
}

std::uint64_t LinkEstimate::maxBytesUnderWay() const {
  const double seconds = std::min(std::max(round_trip_, 0.0) + kAheadSeconds, kMaxAhead);
  return static_cast<std::uint64_t>(std::clamp(bytesPerSecond() * seconds, kMinRoom, kMaxRoom));
}

std::uint64_t LinkEstimate::roomForRequest() const {
  const std::uint64_t max_bytes = maxBytesUnderWay();
  const std::uint64_t part = max_bytes / kRequestsAtOnce;
  return under_way_ + part <= max_bytes ? part : 0;
}

}  // namespace lod::qsplat
