#pragma once
// Loops over independent items on several threads, and a pool of threads.
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "base/error.h"

namespace base {

/// Cores that this process may use, at least 1.
unsigned coreCount();

/// Runs body(i) for i in [0, count) on up to `threads` threads (0: all cores); returns when all are done. Indices are
/// handed out in order, one at a time. The body must not throw.
void parallelFor(std::size_t count, unsigned threads, const std::function<void(std::size_t)>& body);

/// The same with a body that may fail: returns the first error met, and begins no further item after it.
Result<void> tryParallelFor(std::size_t count, unsigned threads, const std::function<Result<void>(std::size_t)>& body);

/// The indices of items of these sizes, the largest first, equal ones in their order. Processed in this order, no large
/// item is left to a single thread in the end.
std::vector<std::size_t> largestFirst(std::span<const std::uint64_t> sizes);

/// Produces items 0 … count − 1 by produce() on up to `threads` threads (0: all cores), and consumes them by consume()
/// in that order, one at a time, on any of these threads. Item i occupies slot i % slots from the start of produce(i,
/// slot) to the end of consume(i, slot), so at most `slots` (at least 1) exist at a time. Returns the first error met,
/// after which nothing more is begun.
Result<void> parallelInOrder(std::size_t count, unsigned threads, std::size_t slots,
                             const std::function<Result<void>(std::size_t i, std::size_t slot)>& produce,
                             const std::function<Result<void>(std::size_t i, std::size_t slot)>& consume);

/// Threads that take jobs from a bounded queue. submit() blocks while the queue is full (back-pressure).
class ThreadPool {
 public:
  explicit ThreadPool(unsigned threads, std::size_t queue_limit);
  ~ThreadPool();  ///< finishes all queued jobs
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  void submit(std::function<void()> job);
  /// Returns when every job submitted so far is done.
  void drain();

 private:
  void runThread();
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> queue_;
  std::size_t queue_limit_;
  std::size_t running_ = 0;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace base
