#pragma once
// Errors of reading a scene while it is served.
#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <set>
#include <string>

#include "base/error.h"

namespace server {

/// Counts the errors and writes them to the log: each message once, at most 100 of them, since a missing pack holds
/// hundreds of faces, and viewers ask for them again and again. Any thread.
class ReadErrors {
 public:
  /// `subject` stands before the message in the log: "image", "download".
  void report(const std::string& subject, const base::Error& error);
  std::uint64_t count() const { return count_; }
  /// Hands `add` how many errors there were up to now, and a 1 for each that comes. It must be good as long as this.
  void countIn(std::function<void(std::uint64_t)> add);

 private:
  std::atomic<std::uint64_t> count_{0};
  std::mutex mutex_;
  std::function<void(std::uint64_t)> add_;
  std::set<std::string> logged_;
};

}  // namespace server
