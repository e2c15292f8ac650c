#pragma once
// A fetcher reads byte ranges of a published scene's objects while the calling thread goes on: libcurl natively,
// fetch() in the browser. A fetcher neither waits, retries nor orders requests; client::RangeQueue does that.
#include <cstdint>
#include <string>
#include <vector>

#include "base/bytes.h"

namespace client {

enum class FetchOutcome {
  kBytes,         ///< all that was asked for
  kNetwork,       ///< no answer, or it broke off: no network, no such host; in a browser also missing CORS headers
  kNotFound,      ///< 404, 410
  kForbidden,     ///< 401, 403
  kRangeIgnored,  ///< 200 to a request for a range, or another range than the one asked for; the body was not read
  kCompressed,    ///< the host set Content-Encoding, and compressed bytes have no ranges
  kChanged,   ///< the ETag (or date, or length) differs from earlier answers about this object, or the status is 412
  kTooShort,  ///< 416, or the object ends within the range
  kServer,    ///< any other status
};

struct FetchAnswer {
  std::uint64_t id = 0;
  FetchOutcome outcome = FetchOutcome::kNetwork;
  base::Bytes bytes;   ///< exactly the requested length with kBytes, else empty
  int status = 0;      ///< HTTP status; 0 when nobody answered
  std::string detail;  ///< the platform's own error text, a few words; may be empty
};

class RangeFetcher {
 public:
  virtual ~RangeFetcher() = default;
  /// Requests bytes offset … offset + length − 1 of the object `name`, which is relative to the scene's folder
  /// ("images/pack-….lgk"). `length` ≥ 1. `id` is chosen by the caller and must not be under way already. An answer
  /// that is longer than requested must be ended as soon as its head is known, since an object may have 10 GB.
  virtual void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) = 0;
  /// Returns the answers that ended since the last call, in any order, each id once.
  virtual std::vector<FetchAnswer> takeAnswers() = 0;
  /// Abandons a request; no answer with this id follows.
  virtual void cancel(std::uint64_t id) = 0;
};

/// Says in one line for people what is wrong with `object` (a URL or a name), and what to do about it.
std::string describeFailure(const FetchAnswer& answer, const std::string& object);

/// Returns true when another try may succeed (network, overloaded server). All other failures need somebody to change
/// something.
bool isTransient(const FetchAnswer& answer);

}  // namespace client
