#pragma once
// Estimates how many bytes may be under way (Rusinkiewicz and Levoy 2001, section 3.5): just enough to keep the link
// busy, so that what a new view needs does not wait behind what an old one did. All streams of files share it. The
// class has no clock: the caller passes seconds, from any zero, that never fall.
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace lod {

class LinkEstimate {
 public:
  /// A request for so many bytes was sent.
  void recordRequest(std::uint64_t bytes, double now);
  /// An answer of `bytes` bytes came to a request for `asked` bytes that was sent at `sent_at`; `bytes` is 0 when the
  /// request failed.
  void recordAnswer(std::uint64_t asked, std::uint64_t bytes, double sent_at, double now);

  std::uint64_t bytesUnderWay() const { return under_way_; }
  double bytesPerSecond() const;  ///< over the last second or two in which the link was busy
  std::uint64_t maxBytesUnderWay() const;
  /// Returns how many bytes one more request may ask for now; 0: none may be sent.
  std::uint64_t roomForRequest() const;

 private:
  // After this many busy seconds a measurement counts half. A choice: a shorter time follows a changing link sooner,
  // and its noise as well.
  static constexpr double kHalfLife = 1.0;
  // Seconds of traffic that are under way beyond a round trip's: as long as a slow frame delays the next requests.
  static constexpr double kAheadSeconds = 0.25;
  // The least is enough to measure an unknown link, and to use links so slow that a block takes long. The most, a
  // choice, bounds what comes too late after a view has changed.
  static constexpr double kMinRoom = 8.0 * 1024.0;
  static constexpr double kMaxRoom = 2.0 * 1024.0 * 1024.0;
  // The shortest round trip seen grows by this factor with each answer, since links change. It may then come to contain
  // the time that our own requests queue, so kMaxAhead bounds it.
  // The factor is a choice: it doubles the value in 347 answers.
  static constexpr double kForget = 1.002;
  static constexpr double kMaxAhead = 0.7;  // seconds
  // A request may ask for one part in so many of what may be under way, so that several overlap. None is sent until
  // that much is free: the HTTP heads of small answers would fill the link.
  static constexpr std::uint64_t kRequestsAtOnce = 4;

  std::uint64_t under_way_ = 0;
  double last_ = 0.0;                   // time of the last answer, or of the first request after silence
  double bytes_ = 0.0, seconds_ = 0.0;  // weighted, the newest answers most
  double round_trip_ = -1.0;            // shortest one seen, seconds; below 0: not known
};

inline void LinkEstimate::recordRequest(std::uint64_t bytes, double now) {
  if (under_way_ == 0) last_ = now;
  under_way_ += bytes;
}

inline void LinkEstimate::recordAnswer(std::uint64_t asked, std::uint64_t bytes, double sent_at, double now) {
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

inline double LinkEstimate::bytesPerSecond() const {
  return seconds_ > 0.0 ? bytes_ / seconds_ : 0.0;
}

inline std::uint64_t LinkEstimate::maxBytesUnderWay() const {
  const double seconds = std::min(std::max(round_trip_, 0.0) + kAheadSeconds, kMaxAhead);
  return static_cast<std::uint64_t>(std::clamp(bytesPerSecond() * seconds, kMinRoom, kMaxRoom));
}

inline std::uint64_t LinkEstimate::roomForRequest() const {
  const std::uint64_t max_bytes = maxBytesUnderWay();
  const std::uint64_t part = max_bytes / kRequestsAtOnce;
  return under_way_ + part <= max_bytes ? part : 0;
}

}  // namespace lod
