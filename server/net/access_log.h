#pragma once
// Keeps the access counts of one server: a thread of its own adds what was counted to the file every so often and at
// the end, so that no session waits for a disk. A file that cannot be written is warned of once, and tried again.
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "repository/access.h"
#include "repository/access_counter.h"

namespace server {

class AccessLog {
 public:
  /// `path`: the file, made when absent (docs/formats/access.md). `most_keys`: as AccessCounter's; twice as many wait
  /// at most while the file cannot be written.
  AccessLog(std::string path, const repository::AccessIdentity& identity, double interval_seconds,
            std::size_t most_keys = 1'000'000);
  ~AccessLog();  ///< writes what is left
  AccessLog(const AccessLog&) = delete;
  AccessLog& operator=(const AccessLog&) = delete;

  repository::AccessCounter& counter() { return counter_; }

 private:
  void work();
  void write(double patience_seconds);
  void hasFailed(const base::Error& error);
  void wake();

  const std::string path_;
  const repository::AccessIdentity identity_;
  const double interval_seconds_;
  const std::size_t most_keys_;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool full_ = false, stopping_ = false;
  repository::AccessCounter counter_;

  // Of the thread alone.
  repository::AccessCounts pending_;  // taken, but not in the file yet
  std::int64_t taken_at_ = 0;         // Unix seconds
  bool failing_ = false;
  std::thread thread_;
};

}  // namespace server
