#pragma once
// Every command of the program prints errors, progress and sizes, and reacts to signals, by these functions. Only
// programs print; libraries do not.
#include <chrono>
#include <cstdint>
#include <string>

#include "base/error.h"
#include "base/text.h"

namespace server::cli {

/// Exit statuses. Only `build --missing` returns kMissing: something is missing.
inline constexpr int kDone = 0, kFailed = 1, kWrongUsage = 2, kMissing = 3;

/// Prints "lumigrid: message" to standard error; returns kFailed.
int fail(const base::Error& error);
/// kDone, or what fail() returns of the error.
inline int exitStatus(const base::Result<void>& done) {
  return done ? kDone : fail(done.error());
}

/// Shows progress on standard error: a bar that is redrawn on a terminal, a plain line every few seconds otherwise,
/// with the time left and this process's memory.
class ProgressLine {
 public:
  explicit ProgressLine(bool quiet);
  ~ProgressLine();
  /// `done` in 0..1; `detail` follows it, e.g. "41.2 images/s".
  void show(const std::string& stage, double done, const std::string& detail = "");
  void finish();  ///< ends the line

 private:
  using Clock = std::chrono::steady_clock;
  bool quiet_;
  bool terminal_;
  bool open_line_ = false;
  std::string stage_;
  Clock::time_point stage_start_, last_shown_;
};

using base::formatBytes;
using base::formatCount;
std::string formatSeconds(double seconds);  ///< "2 min 10 s"
std::uint64_t residentBytes();              ///< memory of this process, now
std::uint64_t peakResidentBytes();          ///< memory of this process, so far

/// After this, writing to a pipe or a connection that nobody reads any more is an error in place of the process's end:
/// for commands whose work is worth more than their lines. The others end quietly in `lumigrid info | head`.
void ignoreBrokenPipes();

/// After this, SIGINT and SIGTERM only set a flag, so that work stops at a clean place; a second one ends the process
/// at once.
void stopOnSignals();
bool stopRequested();

}  // namespace server::cli
