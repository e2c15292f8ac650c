#include "base/parallel.h"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <numeric>

namespace base {

unsigned coreCount() {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof(set), &set) == 0) return static_cast<unsigned>(std::max(1, CPU_COUNT(&set)));
  return std::max(1U, std::thread::hardware_concurrency());
}

void parallelFor(std::size_t count, unsigned threads, const std::function<void(std::size_t)>& body) {
  if (threads == 0) threads = coreCount();
  threads = static_cast<unsigned>(std::min<std::size_t>(threads, count));
  if (threads <= 1) {
    for (std::size_t i = 0; i < count; ++i) body(i);
    return;
  }
  std::atomic<std::size_t> next{0};
  auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) body(i);
  };
  std::vector<std::thread> others;
  for (unsigned t = 1; t < threads; ++t) others.emplace_back(work);
  work();
  for (std::thread& t : others) t.join();
}

Result<void> tryParallelFor(std::size_t count, unsigned threads, const std::function<Result<void>(std::size_t)>& body) {
  std::mutex mutex;
  Result<void> status;
  std::atomic<bool> stopped = false;
  parallelFor(count, threads, [&](std::size_t i) {
    if (stopped) return;
    const Result<void> done = body(i);
    if (done) return;
    const std::lock_guard lock(mutex);
    if (status) status = done;
    stopped = true;
  });
  return status;
}

std::vector<std::size_t> largestFirst(std::span<const std::uint64_t> sizes) {
  std::vector<std::size_t> order(sizes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return sizes[a] > sizes[b]; });
  return order;
}

namespace {

// The progress of parallelInOrder, which its threads share.
class OrderedItems {
 public:
  using Body = std::function<Result<void>(std::size_t i, std::size_t slot)>;
  OrderedItems(std::size_t count, std::size_t slots, const Body& produce, const Body& consume)
      : count_(count), slots_(slots), produce_(produce), consume_(consume), produced_(slots, false) {}

  // Run by each thread until all items are consumed.
  void runThread() {
    std::unique_lock lock(mutex_);
    while (status_ && consumed_ < count_) {
      if (!consuming_ && consumed_ < next_ && produced_[consumed_ % slots_]) {
        consumeOne(lock);
      } else if (next_ < count_ && next_ < consumed_ + slots_) {
        produceOne(lock);
      } else {
        changed_.wait(lock);
      }
    }
  }
  Result<void> status() const { return status_; }

 private:
  void produceOne(std::unique_lock<std::mutex>& lock) {
    const std::size_t i = next_++;
    lock.unlock();
    const Result<void> result = produce_(i, i % slots_);
    lock.lock();
    produced_[i % slots_] = true;
    keepFirstError(result);
  }
  void consumeOne(std::unique_lock<std::mutex>& lock) {
    const std::size_t i = consumed_;
    consuming_ = true;
    lock.unlock();
    const Result<void> result = consume_(i, i % slots_);
    lock.lock();
    produced_[i % slots_] = false;
    consuming_ = false;
    ++consumed_;
    keepFirstError(result);
  }
  void keepFirstError(const Result<void>& result) {
    if (status_ && !result) status_ = result;
    changed_.notify_all();
  }

  const std::size_t count_, slots_;
  const Body& produce_;
  const Body& consume_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<bool> produced_;  // by slot
  std::size_t next_ = 0;        // to be produced
  std::size_t consumed_ = 0;
  bool consuming_ = false;
  Result<void> status_;
};

}  // namespace

Result<void> parallelInOrder(std::size_t count, unsigned threads, std::size_t slots,
                             const std::function<Result<void>(std::size_t i, std::size_t slot)>& produce,
                             const std::function<Result<void>(std::size_t i, std::size_t slot)>& consume) {
  OrderedItems items(count, std::max<std::size_t>(1, slots), produce, consume);
  if (threads == 0) threads = coreCount();
  parallelFor(std::min<std::size_t>(threads, count), threads, [&](std::size_t) { items.runThread(); });
  return items.status();
}

ThreadPool::ThreadPool(unsigned threads, std::size_t queue_limit)
    : queue_limit_(std::max<std::size_t>(1, queue_limit)) {
  for (unsigned t = 0; t < std::max(1U, threads); ++t) threads_.emplace_back([this] { runThread(); });
}

ThreadPool::~ThreadPool() {
  {
    std::unique_lock lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (std::thread& t : threads_) t.join();
}

void ThreadPool::submit(std::function<void()> job) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return queue_.size() < queue_limit_; });
  queue_.push_back(std::move(job));
  lock.unlock();
  changed_.notify_all();
}

void ThreadPool::drain() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return queue_.empty() && running_ == 0; });
}

void ThreadPool::runThread() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return stopping_ || !queue_.empty(); });
    if (queue_.empty()) return;
    std::function<void()> job = std::move(queue_.front());
    queue_.pop_front();
    ++running_;
    lock.unlock();
    changed_.notify_all();
    job();
    lock.lock();
    --running_;
    changed_.notify_all();
  }
}

}  // namespace base
