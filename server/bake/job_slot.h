#pragma once
// The one job that waits between the thread that deals jobs out and those that draw them.
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "repository/sampling/key.h"

namespace server {

/// Faces of one grid point, which are drawn with one cut and one upload.
struct DrawJob {
  std::uint64_t sequence = 0;  ///< number of the first face; the others follow
  std::vector<repository::FaceKey> keys;
};

/// Safe from any thread.
class JobSlot {
 public:
  /// Blocks while a job is waiting. After fail() the job is dropped.
  void submit(DrawJob job) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return failed_ || !job_; });
    if (failed_) return;
    job_ = std::move(job);
    changed_.notify_all();
  }
  /// Takes the job that is waiting, if there is one. With `wait` it waits for one: nothing when there will be none any
  /// more.
  std::optional<DrawJob> takeJob(bool wait) {
    std::unique_lock lock(mutex_);
    if (wait) changed_.wait(lock, [&] { return finishing_ || failed_ || job_; });
    std::optional<DrawJob> job = std::exchange(job_, std::nullopt);
    if (job) changed_.notify_all();
    return job;
  }
  /// Nothing is submitted after it.
  void finish() {
    const std::lock_guard lock(mutex_);
    finishing_ = true;
    changed_.notify_all();
  }
  /// Drops the job that is waiting and all that follow. False when that was so already.
  bool fail() {
    const std::lock_guard lock(mutex_);
    if (std::exchange(failed_, true)) return false;
    job_.reset();
    changed_.notify_all();
    return true;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<DrawJob> job_;
  bool finishing_ = false;
  bool failed_ = false;
};

}  // namespace server
