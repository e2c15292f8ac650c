#pragma once
// The host at the other end of the link of a stream that reads a file in parts (lod/range_requests.h), for tests.
#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <optional>
#include <vector>

#include "base/bytes.h"
#include "lod/byte_range.h"

namespace support {

/// A host that serves a file's bytes and checks the requests.
template <class Stream>
class StreamHost {
 public:
  StreamHost(Stream& stream, base::ByteView bytes) : stream_(stream), bytes_(bytes) {}

  /// Changes an answer's bytes; nullopt: the request fails.
  std::function<std::optional<base::Bytes>(const lod::ByteRange&, base::Bytes)> spoil;
  std::vector<lod::ByteRange> asked;

  /// Accepts new requests. No byte of them may be under way already.
  void acceptRequests(double now) {
    for (const lod::ByteRange& range : stream_.nextRequests(now)) {
      ASSERT_GT(range.length, 0U);
      ASSERT_LE(range.offset + range.length, bytes_.size());
      for (const lod::ByteRange& other : queue_)
        ASSERT_TRUE(range.offset >= other.offset + other.length || other.offset >= range.offset + range.length)
            << "bytes from " << range.offset << " are under way already";
      queue_.push_back(range);
      asked.push_back(range);
    }
  }
  /// Answers one of the requests under way, of which there is one at least.
  void answerOne(double now, std::size_t which = 0) {
    const auto at = queue_.begin() + static_cast<std::ptrdiff_t>(which % queue_.size());
    const lod::ByteRange range = *at;
    queue_.erase(at);
    const base::ByteView part = bytes_.subspan(range.offset, range.length);
    base::Bytes answer(part.begin(), part.end());
    std::optional<base::Bytes> spoilt = spoil ? spoil(range, answer) : std::optional(answer);
    if (!spoilt) return stream_.acceptFailure(range.id, now);
    stream_.acceptAnswer(range.id, *spoilt, now);
  }
  std::size_t underWay() const { return queue_.size(); }

 private:
  Stream& stream_;
  const base::ByteView bytes_;
  std::deque<lod::ByteRange> queue_;
};

/// Streams one view until it is complete, and returns what is drawn in the end. `each` sees each frame.
template <class Drawn, class Stream, class Request>
std::vector<Drawn> fetchView(Stream& stream, StreamHost<Stream>& host, const Request& request, double& now,
                             const std::function<void(const std::vector<Drawn>&)>& each = {}) {
  std::vector<Drawn> drawn;
  for (int turn = 0; turn < 20'000; ++turn) {
    stream.update(request, drawn);
    if (each) each(drawn);
    if (stream.complete() || !stream.problem().empty()) break;
    host.acceptRequests(now);
    now += 0.01;
    if (host.underWay() > 0) host.answerOne(now, static_cast<std::size_t>(turn));
  }
  return drawn;
}

}  // namespace support
