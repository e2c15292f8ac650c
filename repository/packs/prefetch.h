#pragma once
// Work that waits for a disk or a network, several pieces under way at a time, taken in their order.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <utility>

namespace repository {

struct PrefetchLimits {
  unsigned jobs = 1;        ///< pieces under way at a time
  std::uint64_t bytes = 0;  ///< … and bytes that they take in memory together; one piece always goes
};

/// take(i, make(i)) for i = 0 … count − 1, on this thread and in this order, until it returns false; make() runs on
/// threads of its own, ahead within the limits. `bytes_of(i)`: what a piece takes.
template <class Make, class Take>
void prefetchInOrder(std::size_t count, const PrefetchLimits& limits,
                     const std::function<std::uint64_t(std::size_t)>& bytes_of, const Make& make, const Take& take) {
  struct Piece {
    std::uint64_t bytes;
    std::future<decltype(make(std::size_t{0}))> made;
  };
  std::deque<Piece> ahead;
  std::uint64_t bytes_ahead = 0;
  std::size_t next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    while (next < count && ahead.size() < std::max(1U, limits.jobs) &&
           (ahead.empty() || bytes_ahead + bytes_of(next) <= limits.bytes)) {
      const std::uint64_t bytes = bytes_of(next);
      ahead.push_back({bytes, std::async(std::launch::async, [&make, next] { return make(next); })});
      bytes_ahead += bytes;
      ++next;
    }
    Piece piece = std::move(ahead.front());
    ahead.pop_front();
    const bool more = take(i, piece.made.get());
    bytes_ahead -= piece.bytes;
    if (!more) return;
  }
}

}  // namespace repository
