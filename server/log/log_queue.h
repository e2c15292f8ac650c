#pragma once
// The lines that wait to be written: bounded, so that a log that nobody reads costs a fixed amount of memory.
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "server/log/log_text.h"

namespace server {

/// Not safe for several threads: the caller locks.
class LogQueue {
 public:
  /// Holds at most so many lines, and bytes of their texts; one line fits always.
  LogQueue(std::size_t max_lines, std::size_t max_bytes) : max_lines_(max_lines), max_bytes_(max_bytes) {}

  /// False: there was no room, and the line is dropped and counted.
  bool push(LogEntry entry);
  /// The oldest line. Where lines were dropped, one that tells how many comes in their place.
  std::optional<LogEntry> pop();

  bool empty() const { return lines_.empty() && dropped_ == 0; }
  std::size_t size() const { return lines_.size(); }

 private:
  struct Line {
    LogEntry entry;
    std::uint64_t dropped_before = 0;
  };
  const std::size_t max_lines_, max_bytes_;
  std::deque<Line> lines_;
  std::size_t bytes_ = 0;
  std::uint64_t dropped_ = 0;  // since the last line of the queue
  std::chrono::system_clock::time_point dropped_at_;
};

}  // namespace server
