#include "server/log/log_queue.h"

#include <utility>

namespace server {
namespace {

LogEntry droppedEntry(std::uint64_t lines, std::chrono::system_clock::time_point time) {
  return {time, LogLevel::kWarning,
          lines == 1 ? "1 line was dropped: whoever reads the log is too slow"
                     : std::to_string(lines) + " lines were dropped: whoever reads the log is too slow"};
}

}  // namespace

bool LogQueue::push(LogEntry entry) {
  const std::size_t size = entry.text.size();
  if (!lines_.empty() && (lines_.size() >= max_lines_ || bytes_ + size > max_bytes_)) {
    ++dropped_;
    dropped_at_ = entry.time;
    return false;
  }
  bytes_ += size;
  lines_.push_back({std::move(entry), std::exchange(dropped_, 0)});
  return true;
}

std::optional<LogEntry> LogQueue::pop() {
  if (lines_.empty()) {
    if (dropped_ == 0) return std::nullopt;
    return droppedEntry(std::exchange(dropped_, 0), dropped_at_);
  }
  Line& line = lines_.front();
  if (line.dropped_before > 0) return droppedEntry(std::exchange(line.dropped_before, 0), line.entry.time);
  LogEntry entry = std::move(line.entry);
  bytes_ -= entry.text.size();
  lines_.pop_front();
  return entry;
}

}  // namespace server
