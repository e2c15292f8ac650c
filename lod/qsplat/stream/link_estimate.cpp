#include "lod/qsplat/stream/link_estimate.h"

#include <algorithm>
#include <cmath>

namespace lod::qsplat {
namespace {

// After so many busy seconds what was measured counts half.
constexpr double kHalfLife = 1.0;
// Beside a round trip's: what a slow frame passes before more is asked for.
constexpr double kAheadSeconds = 0.25;
// Enough for the first look at an unknown link, and for links so slow that a block takes long.
constexpr double kMinRoom = 8.0 * 1024.0;
constexpr double kMaxRoom = 2.0 * 1024.0 * 1024.0;
// The shortest round trip that was seen is forgotten by so much with each answer: links change. Its own queue may then
// pass for the link's, so there is an end to it.
constexpr double kForget = 1.002;
constexpr double kMaxAhead = 0.7;  // seconds
// A request may have this part of what may be under way: while one is on its way the next ones are, too. Until so much
// room is free none leaves: heads of small answers would fill the link.
constexpr std::uint64_t kParts = 4;

}  // namespace

void LinkEstimate::sent(std::uint64_t bytes, double now) {
  if (under_way_ == 0) last_ = now;
  under_way_ += bytes;
}

void LinkEstimate::came(std::uint64_t asked, std::uint64_t bytes, double sent_at, double now) {
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

std::uint64_t LinkEstimate::mostUnderWay() const {
  const double seconds = std::min(std::max(round_trip_, 0.0) + kAheadSeconds, kMaxAhead);
  return static_cast<std::uint64_t>(std::clamp(bytesPerSecond() * seconds, kMinRoom, kMaxRoom));
}

std::uint64_t LinkEstimate::room() const {
  const std::uint64_t most = mostUnderWay();
  const std::uint64_t part = most / kParts;
  return under_way_ + part <= most ? part : 0;
}

}  // namespace lod::qsplat
