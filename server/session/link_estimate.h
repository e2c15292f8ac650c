#pragma once
// The estimate of a client's link from what the transport tells: how fast acknowledgements come while more waits to be
// sent, and how long a message waits. It knows no clock; the transport brings the time.
#include <cstdint>
#include <list>

namespace server {

/// The transport's state at one instant.
struct LinkState {
  double seconds = 0.0;                 ///< since any zero; never decreases
  std::uint64_t unsent_bytes = 0;       ///< handed out by the session, and still waiting at the server
  std::uint64_t unconfirmed_bytes = 0;  ///< sent, and not yet acknowledged
  double round_trip_seconds = 0.0;      ///< as the transport measured it last; 0: not known
};

class LinkEstimate {
 public:
  /// `handed_out`: bytes of all messages that the transport was given so far.
  void update(const LinkState& state, std::uint64_t handed_out);
  double now() const { return state_.seconds; }
  /// Bytes a second towards the client; an assumption (kAssumedRate) before anything was measured. Above 0.
  double rate() const { return rate_; }
  /// Whether the rate was measured, or more went through than a slow link would have carried unnoticed.
  bool isKnown() const { return measured_ || confirmed_ >= kKnownBytes; }
  /// Whether the rate was measured. Buffers on the way, as of a proxy, can take some bytes at any rate.
  bool isMeasured() const { return measured_; }
  /// Whether more waits at the server than may while the rate is not measured: a small part of what went through
  /// without waiting for long enough to be measured. So a slow link has nothing ahead of a new view's frame, and a fast
  /// one is not asked after each message whether it took that.
  bool isFullUnmeasured() const { return static_cast<double>(state_.unsent_bytes) > kProvenShare * confirmed_; }
  /// Seconds since something was acknowledged last, or since the zero.
  double quietSeconds() const { return state_.seconds - arrived_at_; }
  /// Whether nothing that was handed out is still on its way.
  bool isIdle() const { return state_.unsent_bytes + state_.unconfirmed_bytes == 0; }
  /// The shortest round trip so far, seconds; 0 before one is known.
  double roundTrip() const { return round_trip_; }
  /// Seconds that a byte handed out now waits before it is under way as if the link were idle.
  double queueSeconds() const;
  /// The part of it at the server, behind what TCP has under way.
  double unsentSeconds() const { return static_cast<double>(state_.unsent_bytes) / rate_; }
  /// Seconds for which the last of so many bytes, handed out now, would wait at the server; 0 while the round trip is
  /// not known.
  double waitSeconds(double bytes) const;
  /// Seconds until so many bytes have left over an idle link. After a pause TCP sends few bytes a round trip at first.
  double transferSeconds(double bytes) const;

  static constexpr double kAssumedRate = 1e6;
  /// Bytes that a connection sends before the first acknowledgement: ten segments (RFC 6928).
  static constexpr double kFirstWindow = 14'600.0;
  /// Once so many went through, a link that was not full yet counts as known (isKnown()).
  static constexpr double kKnownBytes = 2.0 * kFirstWindow;
  static constexpr double kProvenShare = 1.0 / 16.0;  ///< a choice

 private:
  /// Bytes up to `end` were sent at `at`, seconds.
  struct Mark {
    double end, at;
  };
  void takeSent(double sent);
  bool isLate() const;
  void takeSample(bool arrived);
  void growWhileIdle(double seconds, double arrived);
  void growWindow(double arrived, bool idle);

  LinkState state_;
  double rate_ = kAssumedRate;
  double fastest_ = kAssumedRate;  // of the newest sample, or before there is one of what went through without waiting
  double round_trip_ = 0.0;
  bool measured_ = false;
  bool was_busy_ = false;
  bool arrives_ = false;  // something was acknowledged since the link became busy
  bool queues_ = true;    // all the time since the last sample was taken, bytes waited in a queue on the way
  double busy_seconds_ = 0.0, busy_bytes_ = 0.0;  // since the last sample was taken
  double idle_seconds_ = 0.0, idle_bytes_ = 0.0;  // without waiting and before a sample, since fastest_ was last set
  double confirmed_ = 0.0;                        // bytes acknowledged so far
  double arrived_at_ = 0.0;                       // when it last grew, seconds
  std::list<Mark> sent_;                          // and not yet acknowledged, the oldest first
  double window_ = kFirstWindow;                  // bytes that TCP has under way at most, as far as its start tells
  double last_traffic_ = 0.0;                     // when bytes were last under way, seconds
};

}  // namespace server
