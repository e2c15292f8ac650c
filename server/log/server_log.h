#pragma once
// The log of a server. Whoever logs only copies the line into a bounded queue; one thread formats and writes. So a
// reader of the log that stops reading costs lines, which are counted, and never a viewer's time; one that goes away,
// or a full disk, never ends the process (docs/decisions/log-queue.md).
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "base/error.h"
#include "server/log/log_text.h"

namespace server {

struct LogOptions {
  std::string file;    ///< empty: `descriptor`
  int descriptor = 2;  ///< standard error
  bool json = false;   ///< one JSON object a line
  std::size_t max_lines = 8192;
  std::size_t max_bytes = std::size_t{4} << 20;  ///< of the lines that wait
  std::uint32_t lines_per_second = 20;           ///< of one kind (log_rate.h); 0: no limit
};

/// Numbers of lines since the start.
struct LogCounts {
  std::uint64_t written = 0;
  std::uint64_t dropped = 0;   ///< the queue was full
  std::uint64_t left_out = 0;  ///< more than lines_per_second of their kind
  std::uint64_t failed = 0;    ///< the system refused to write them
};

/// The process ignores SIGPIPE. All threads may call all of it.
class ServerLog {
 public:
  /// Starts the thread. The error says that the file cannot be written.
  static base::Result<std::unique_ptr<ServerLog>> open(const LogOptions& options);
  /// Spends at most a second on the lines that wait.
  ~ServerLog();
  ServerLog(const ServerLog&) = delete;
  ServerLog& operator=(const ServerLog&) = delete;

  /// Makes this the place of spdlog::info() and its like; before, it was the standard error of spdlog's own. Lasts
  /// until the end of this.
  void install();
  /// Never waits for the reader.
  void add(LogLevel level, std::string text);
  /// Has the thread open the file anew, before the next line. When that fails it says so in the old one.
  void reopen();
  LogCounts counts() const;

 private:
  struct State;
  explicit ServerLog(std::shared_ptr<State> state);
  // Shared with the thread, which is left behind when it still waits for a reader at the end.
  std::shared_ptr<State> state_;
  struct Installed;
  std::unique_ptr<Installed> installed_;
};

}  // namespace server
