#include "base/parallel.h"

#include <sched.h>

#include <algorithm>
#include <atomic>

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

ThreadPool::ThreadPool(unsigned threads, std::size_t queue_limit)
    : queue_limit_(std::max<std::size_t>(1, queue_limit)) {
  for (unsigned t = 0; t < std::max(1U, threads); ++t) threads_.emplace_back([this] { work(); });
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

void ThreadPool::work() {
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
