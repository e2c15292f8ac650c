#pragma once
// Where log lines go: a descriptor of this process, or a file that can be opened anew under its name.
#include <chrono>
#include <string>
#include <string_view>

#include "base/error.h"

namespace server {

/// Used by one thread.
class LogOutput {
 public:
  /// `descriptor`: of standard error, say. It stays open, and its flags stay as they are: it may be shared with the
  /// shell that started this process.
  explicit LogOutput(int descriptor) : descriptor_(descriptor) {}
  /// Opens or makes the file and appends to it. The error names it.
  static base::Result<LogOutput> openFile(const std::string& path);
  ~LogOutput();
  LogOutput(LogOutput&& other) noexcept;
  LogOutput& operator=(LogOutput&&) = delete;

  enum class Outcome {
    kWritten,  ///< all of it
    kBusy,     ///< the reader takes nothing at present
    kFailed,   ///< error() says why; the line is lost
  };
  /// Writes from the front of `rest` and removes what is written, until nothing is left or `patience` is over. The
  /// process ignores SIGPIPE. A write to a shared pipe can wait longer when another process fills it meanwhile.
  Outcome write(std::string_view& rest, std::chrono::milliseconds patience);
  /// The errno of the last failure.
  int error() const { return error_; }

  /// Opens the file anew after somebody renamed it. On an error the old one stays. Nothing to do for a descriptor.
  base::Result<void> reopen();

 private:
  long writeSome(std::string_view bytes) const;

  int descriptor_;
  std::string path_;  // empty: the descriptor is not ours
  int error_ = 0;
};

}  // namespace server
