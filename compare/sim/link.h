#pragma once
// A network link in virtual time, and a TCP connection over it. Nothing here waits or looks at a clock: the caller says
// what time it is, and the same calls with the same seed give the same bytes at the same instants on every machine.
//
// The model of TCP (docs/formats/comparison.md, "The link"): segments of 1460 bytes; a window of 10 segments at first
// (RFC 6928) that grows by one with each acknowledgement until the first loss, then by one a round trip (RFC 5681); a
// lost segment is sent again after one round trip and holds back all that follow it, and the window is halved, once a
// round trip; after a pause of a round trip or 200 ms the window is 10 again. The window is at most what the link holds
// and one queue of 64 KiB or 1.5 times that, so that no buffer on the way fills for seconds. Acknowledgements are never
// lost.
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "server/views/random_views.h"

namespace compare {

/// Round trips before the first message of a WebSocket: TCP's handshake and its own.
inline constexpr double kHandshakeRoundTrips = 2.0;
inline constexpr double kNever = std::numeric_limits<double>::infinity();

struct LinkProfile {
  std::string name;                 ///< as the user spelled it
  double bytes_per_second = 0.0;    ///< > 0; towards the client. The way back has the same.
  double round_trip_seconds = 0.0;  ///< without queues and without jitter
  double jitter_seconds = 0.0;      ///< each segment takes up to so much longer; segments never overtake
  double loss = 0.0;                ///< probability that a segment is lost, 0 … 0.5
  double on_seconds = 0.0;          ///< > 0: after so long the link is away for off_seconds, and so on
  double off_seconds = 0.0;
  double up_already_seconds = 0.0;  ///< how long it has been up when the client begins to connect
};

/// Reads "RATE/ROUND_TRIP[/JITTER[/LOSS]]", such as "20Mbit/40ms" or "5Mbit/60ms/20ms/1%", or "train": 20 Mbit/s and
/// 40 ms for 10 s, then nothing for 5 s; it begins 3 s before a tunnel, so that short paths see one.
base::Result<LinkProfile> parseLink(const std::string& text);

/// The wire that the connections of one direction share.
class Wire {
 public:
  explicit Wire(const LinkProfile& link) : link_(link) {}
  /// Puts a segment on the wire, at `now` or when it is free. Returns when its last byte has left.
  double depart(std::uint64_t bytes, double now);
  const LinkProfile& link() const { return link_; }

 private:
  double whenUp(double time) const;
  LinkProfile link_;
  double free_ = 0.0;
};

/// One direction of a TCP connection, which carries whole messages in their order.
class Pipe {
 public:
  Pipe(std::shared_ptr<Wire> wire, std::uint32_t seed);

  /// Hands a message to the connection. `now` never decreases, here and below.
  void send(base::Bytes message, double now);
  /// Sends what the window allows, and takes the acknowledgements that are due.
  void advance(double now);
  /// Returns the next message whose last byte has arrived.
  std::optional<base::Bytes> take(double now);
  /// Returns when advance() or take() has something to do; kNever if only send() changes anything.
  double nextEvent() const;
  /// Bytes handed to send() that have not left: a server with TCP_NOTSENT_LOWAT writes no more while there are many.
  std::uint64_t unsentBytes() const { return written_ - sent_; }
  /// Bytes that have left and are not acknowledged yet.
  std::uint64_t unconfirmedBytes() const { return sent_ - confirmed_; }
  double roundTripSeconds() const { return wire_->link().round_trip_seconds; }
  std::uint64_t deliveredBytes() const { return taken_; }

 private:
  struct Message {
    std::uint64_t end;  ///< place in the stream
    base::Bytes bytes;
  };
  struct Segment {
    double arrives;
    std::uint64_t end;
  };
  struct Acknowledgement {
    double arrives;
    std::uint64_t end;  ///< of the segment
    bool lost;          ///< the segment was lost at first
  };
  void sendSegment(double now);
  void acknowledge(const Acknowledgement& ack);
  double oneWay() const { return 0.5 * wire_->link().round_trip_seconds; }

  std::shared_ptr<Wire> wire_;
  server::UnitRandom random_;
  std::deque<Message> messages_;  ///< not taken yet
  std::deque<Segment> arriving_;
  std::deque<Acknowledgement> acks_;
  std::uint64_t written_ = 0, sent_ = 0, confirmed_ = 0, arrived_ = 0, taken_ = 0;
  double window_, threshold_, max_window_;  ///< segments
  double halved_until_ = -1.0;              ///< until then no loss halves the window again
  double last_sent_ = 0.0, last_arrival_ = 0.0;
};

}  // namespace compare
