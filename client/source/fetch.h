#pragma once
// Byte ranges of a published scene's objects, fetched while the thread that asks goes on: libcurl natively, fetch() in
// the browser. Nothing here waits, retries or orders; client::RangeQueue does that.
#include <cstdint>
#include <string>
#include <vector>

#include "base/bytes.h"

namespace client {

enum class FetchOutcome {
  kBytes,         ///< all that was asked for
  kNetwork,       ///< no answer, or it broke off: no network, no such host; in a browser also: no CORS headers
  kNotFound,      ///< 404, 410
  kForbidden,     ///< 401, 403
  kRangeIgnored,  ///< 200 to a request for a range, or another range than was asked for; nothing of the body was taken
  kCompressed,    ///< Content-Encoding: such bytes have no ranges
  kChanged,       ///< another ETag (or date, or length) than in earlier answers about this object, or 412
  kTooShort,      ///< 416, or the object ends within the range
  kServer,        ///< any other status
};

struct FetchAnswer {
  std::uint64_t id = 0;
  FetchOutcome outcome = FetchOutcome::kNetwork;
  base::Bytes bytes;   ///< of the length asked for when kBytes, else empty
  int status = 0;      ///< of HTTP; 0: no answer
  std::string detail;  ///< what the platform says of it, a few words; may be empty
};

class RangeFetcher {
 public:
  virtual ~RangeFetcher() = default;
  /// Bytes offset … offset + length − 1 of the object `name`, relative to the scene's folder ("images/pack-….lgk").
  /// `length` ≥ 1; `id` is the caller's, not under way already. Must end an answer that is longer than asked for as
  /// soon as its head is known: an object may have 10 GB.
  virtual void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) = 0;
  /// What ended since the last call, in any order, each id once.
  virtual std::vector<FetchAnswer> takeAnswers() = 0;
  /// Nothing more is heard of this id.
  virtual void cancel(std::uint64_t id) = 0;
};

/// One line for people: what is wrong with `what` (a URL or a name), and what to do about it.
std::string describeFailure(const FetchAnswer& answer, const std::string& what);

/// Whether the next try may go better (network, overloaded server); the others need somebody to change something.
bool isTransient(const FetchAnswer& answer);

}  // namespace client
