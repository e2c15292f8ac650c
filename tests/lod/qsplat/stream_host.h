#pragma once
// The host at the other end of a stream's link, for tests.
#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "lod/qsplat/stream/stream.h"

namespace lod::qsplat {

/// A host that serves a file's bytes and checks the requests.
class Host {
 public:
  Host(Stream& stream, base::Bytes bytes) : stream_(stream), bytes_(std::move(bytes)) {}

  /// Changes an answer's bytes; nullopt: the request fails.
  std::function<std::optional<base::Bytes>(const ByteRange&, base::Bytes)> spoil;
  std::vector<ByteRange> asked;
  std::uint64_t sent = 0;

  /// Accepts new requests. No byte of them may be under way already.
  void acceptRequests(double now) {
    for (const ByteRange& range : stream_.nextRequests(now)) {
      ASSERT_GT(range.length, 0U);
      ASSERT_LE(range.offset + range.length, bytes_.size());
      for (const ByteRange& other : queue_)
        ASSERT_TRUE(range.offset >= other.offset + other.length || other.offset >= range.offset + range.length)
            << "bytes from " << range.offset << " are under way already";
      queue_.push_back(range);
      asked.push_back(range);
    }
  }
  /// Answers the oldest request, or the newest.
  void answerOne(double now, bool newest = false) {
    const ByteRange range = newest ? queue_.back() : queue_.front();
    newest ? queue_.pop_back() : queue_.pop_front();
    base::Bytes answer(bytes_.begin() + static_cast<std::ptrdiff_t>(range.offset),
                       bytes_.begin() + static_cast<std::ptrdiff_t>(range.offset + range.length));
    std::optional<base::Bytes> spoiled = spoil ? spoil(range, answer) : std::optional(answer);
    if (!spoiled) return stream_.acceptFailure(range.id, now);
    sent += spoiled->size();
    stream_.acceptAnswer(range.id, *spoiled, now);
  }
  std::size_t underWay() const { return queue_.size(); }

 private:
  Stream& stream_;
  const base::Bytes bytes_;
  std::deque<ByteRange> queue_;
};

inline StreamOptions withoutIdling() {
  StreamOptions options;
  options.idle_bytes = 0;
  return options;
}

/// Streams one view until it is complete, and returns the final splats.
inline Traversal fetchAll(Stream& stream, Host& host, const TraverseRequest& request, double& now,
                          const std::function<void(const Traversal&)>& each = {}) {
  Traversal found;
  for (int turn = 0; turn < 20'000; ++turn) {
    stream.traverse(request, std::nullopt, found);
    if (each) each(found);
    if (stream.complete() || !stream.problem().empty()) break;
    host.acceptRequests(now);
    now += 0.01;
    if (host.underWay() > 0) host.answerOne(now);
  }
  return found;
}

}  // namespace lod::qsplat
