#pragma once
// The requests of a stream that reads parts of a file over a link: which are under way, when the next may be sent, and
// which parts one request joins. Streams of pmr.lgm and hlod.lgh share it.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>

#include "lod/byte_range.h"
#include "lod/link_estimate.h"

namespace lod {

/// The first request brings the header and, mostly, the table; of a small file it brings all.
inline constexpr std::uint64_t kFrontBytes = 65'536;
inline constexpr std::uint64_t kSmallFile = 131'072;
/// So many bytes that are not wanted are fetched rather than beginning another request. More where the link is fast
/// cost a fifth more bytes at 100 Mbit/s, and no view came sooner.
inline constexpr std::uint64_t kMaxGap = 4096;
/// A part that came damaged this often is given up.
inline constexpr int kMaxDamages = 3;

struct PendingRequest {
  ByteRange range;
  double sent_at = 0.0;
  bool is_front = false;              ///< asks for header and table
  std::uint64_t first = 0, last = 0;  ///< places of the parts in the file's order, unless is_front
};

/// Asks for header and table. `here`: bytes of them that have come; once there are any, `wanted` is how many there are.
inline PendingRequest frontRequest(std::uint64_t file_bytes, std::uint64_t here, std::uint64_t wanted) {
  PendingRequest request;
  request.is_front = true;
  request.range.offset = here;
  request.range.length = here != 0 ? wanted - here : file_bytes <= kSmallFile ? file_bytes : kFrontBytes;
  return request;
}

/// The class has no clock: the caller passes seconds, from any zero, that never fall.
class RangeRequests {
 public:
  /// How many bytes one more request may ask for now; 0: none may be sent.
  std::uint64_t roomAt(double now, std::size_t max_requests) const {
    return now < pause_until_ || under_way_.size() >= max_requests ? 0 : link_.roomForRequest();
  }
  bool frontIsUnderWay() const {
    return std::any_of(under_way_.begin(), under_way_.end(), [](const auto& one) { return one.second.is_front; });
  }
  std::size_t underWay() const { return under_way_.size(); }

  ByteRange send(PendingRequest request, double now) {
    request.range.id = ++requests_;
    request.sent_at = now;
    under_way_[request.range.id] = request;
    link_.recordRequest(request.range.length, now);
    return request.range;
  }
  /// The request that is answered by so many bytes, which is no longer under way; nullopt where there is none. It has
  /// failed, and is followed by a pause, where the bytes are not as many as it asked for.
  struct Answered {
    PendingRequest request;
    bool has_failed = false;
  };
  std::optional<Answered> takeAnswered(std::uint64_t id, std::uint64_t bytes, double now) {
    bytes_received_ += bytes;
    const auto found = under_way_.find(id);
    if (found == under_way_.end()) return std::nullopt;
    const Answered answered{found->second, bytes != found->second.range.length};
    const PendingRequest& request = answered.request;
    under_way_.erase(found);
    link_.recordAnswer(request.range.length, answered.has_failed ? 0 : bytes, request.sent_at, now);
    if (answered.has_failed)
      pauseAfterFailure(request.sent_at, now);
    else
      failures_in_a_row_ = 0;
    return answered;
  }
  /// Counts an answer that came whole and was damaged. No pause follows: the host answers, and kMaxDamages ends
  /// repeated requests.
  void countDamage() { ++failures_; }

  double bytesPerSecond() const { return link_.bytesPerSecond(); }
  std::uint64_t requests() const { return requests_; }
  std::uint64_t failures() const { return failures_; }
  std::uint64_t bytesReceived() const { return bytes_received_; }

 private:
  // After each failure in a row the pause doubles. These are choices: longer pauses spare a host that is broken,
  // shorter ones go on sooner with one that was restarted.
  static constexpr double kMinPause = 0.25, kMaxPause = 5.0;  // seconds

  void pauseAfterFailure(double sent_at, double now) {
    ++failures_;
    // Requests that were under way when another one failed have the same cause; the pause does not double for them.
    if (sent_at < paused_at_) return;
    paused_at_ = now;
    const double pause = kMinPause * std::exp2(std::min(failures_in_a_row_++, 8));
    pause_until_ = now + std::min(pause, kMaxPause);
  }

  std::map<std::uint64_t, PendingRequest> under_way_;
  LinkEstimate link_;
  double pause_until_ = -1e300, paused_at_ = -1e300;
  int failures_in_a_row_ = 0;
  std::uint64_t requests_ = 0, failures_ = 0, bytes_received_ = 0;
};

/// A part of the file at a place of its order.
struct RequestablePart {
  std::uint64_t bytes = 0;
  bool is_wanted = false;  ///< and neither here nor under way
  bool is_under_way = false;
};

/// Extends a request that begins or ends at the place `from` and has so many bytes by neighbours that are wanted, too,
/// and by gaps of at most kMaxGap bytes between them; returns its new end. `direction`: 1 or −1. The parts at places
/// begin … end − 1 lie one behind the other.
template <class PartAt>
std::uint64_t extendRequest(std::uint64_t from, int direction, std::uint64_t begin, std::uint64_t end,
                            std::uint64_t max_bytes, std::uint64_t& bytes, const PartAt& partAt) {
  std::uint64_t farthest = from;
  std::uint64_t more = 0, gap = 0;  // bytes since `farthest`, and of these the ones that are not wanted
  while (direction > 0 ? ++from < end : from-- > begin) {
    const RequestablePart part = partAt(from);
    if (part.is_under_way) break;
    more += part.bytes;
    gap += part.is_wanted ? 0 : part.bytes;
    if (gap > kMaxGap || bytes + more > max_bytes) break;
    if (!part.is_wanted) continue;
    farthest = from;
    bytes += more;
    more = gap = 0;
  }
  return farthest;
}

}  // namespace lod
