#pragma once
// Keeps the access counts of one server. A thread of its own adds them to the file at intervals and at the end, so that
// no session waits for a disk. When the file cannot be written, the log says so once, and writing is tried again.
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "repository/access.h"
#include "repository/access_counter.h"

namespace server {

/// Its end writes what is left.
class AccessLog {
 public:
  /// `path`: the file, made when absent (docs/formats/access.md). `max_keys`: as AccessCounter's; at most twice as many
  /// wait while the file cannot be written.
  AccessLog(std::string path, const repository::AccessIdentity& identity, double interval_seconds,
            std::size_t max_keys = 1'000'000);

  /// Writes what is left, and ends the thread; what is counted later is lost.
  void finish();
  repository::AccessCounter& counter() { return counter_; }

 private:
  void runThread(const std::stop_token& stop);
  void write(double patience_seconds);
  void logFailure(const base::Error& error);
  void wake();

  const std::string path_;
  const repository::AccessIdentity identity_;
  const double interval_seconds_;
  const std::size_t max_keys_;

  std::mutex mutex_;
  std::condition_variable_any changed_;
  bool full_ = false;
  repository::AccessCounter counter_;

  // Used by the thread alone.
  std::string place_;                 // where the counts lie: `path_`, or beside it while that is another scene's
  repository::AccessCounts pending_;  // taken from the counter, but not in the file yet
  std::int64_t pending_until_ = 0;    // when they were taken, Unix seconds
  bool failing_ = false;

  std::jthread thread_;  // last: it uses the others
};

}  // namespace server
