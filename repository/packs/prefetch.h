#pragma once
// Runs items of work that wait for a disk or a network on several threads, and hands over their results in order.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <utility>

namespace repository {

struct PrefetchLimits {
  unsigned jobs = 1;        ///< items in work at a time
  std::uint64_t bytes = 0;  ///< … and the bytes of memory that they take together; one item is always allowed
};

/// Calls accept(i, fetch(i)) for i = 0 … count − 1, on this thread and in this order, until it returns false. fetch()
/// runs ahead on threads of its own, within the limits; item i takes bytes_of(i) bytes of memory.
template <class Fetch, class Accept>
void prefetchInOrder(std::size_t count, const PrefetchLimits& limits,
                     const std::function<std::uint64_t(std::size_t)>& bytes_of, const Fetch& fetch,
                     const Accept& accept) {
  struct Item {
    std::uint64_t bytes;
    std::future<decltype(fetch(std::size_t{0}))> result;
  };
  std::deque<Item> ahead;
  std::uint64_t bytes_ahead = 0;
  std::size_t next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    while (next < count && ahead.size() < std::max(1U, limits.jobs) &&
           (ahead.empty() || bytes_ahead + bytes_of(next) <= limits.bytes)) {
      const std::uint64_t bytes = bytes_of(next);
      ahead.push_back({bytes, std::async(std::launch::async, [&fetch, next] { return fetch(next); })});
      bytes_ahead += bytes;
      ++next;
    }
    Item item = std::move(ahead.front());
    ahead.pop_front();
    const bool more = accept(i, item.result.get());
    bytes_ahead -= item.bytes;
    if (!more) return;
  }
}

}  // namespace repository
