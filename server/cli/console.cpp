#include "server/cli/console.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <fstream>

namespace server::cli {
namespace {

std::atomic<bool> stop_requested{false};

extern "C" void onSignal(int signal) {
  stop_requested = true;
  std::signal(signal, SIG_DFL);
}

}  // namespace

int fail(const base::Error& error) {
  std::fprintf(stderr, "lumigrid: %s\n", error.message.c_str());
  return kFailed;
}

ProgressLine::ProgressLine(bool quiet) : quiet_(quiet), terminal_(::isatty(STDERR_FILENO) != 0) {}

ProgressLine::~ProgressLine() {
  finish();
}

void ProgressLine::show(const std::string& stage, double done, const std::string& detail) {
  if (quiet_) return;
  const auto now = Clock::now();
  if (stage != stage_) {
    finish();
    stage_ = stage;
    stage_start_ = now;
    last_shown_ = {};
  }
  const double pause = terminal_ ? 0.1 : 5.0;
  if (done < 1.0 && std::chrono::duration<double>(now - last_shown_).count() < pause) return;
  last_shown_ = now;
  const double elapsed = std::chrono::duration<double>(now - stage_start_).count();
  std::string text = stage_ + " " + std::to_string(static_cast<int>(std::clamp(done, 0.0, 1.0) * 100.0)) + " %";
  if (!detail.empty()) text += ", " + detail;
  if (done > 0.01 && done < 1.0) text += ", " + formatSeconds(elapsed * (1.0 - done) / done) + " left";
  text += ", " + formatBytes(residentBytes()) + " memory";
  if (terminal_) {
    std::string bar(24, '.');
    std::fill_n(bar.begin(), static_cast<std::size_t>(std::clamp(done, 0.0, 1.0) * 24.0), '#');
    std::fprintf(stderr, "\r\033[K[%s] %s", bar.c_str(), text.c_str());
    open_line_ = true;
  } else {
    std::fprintf(stderr, "%s\n", text.c_str());
  }
  std::fflush(stderr);
}

void ProgressLine::finish() {
  if (open_line_) std::fputc('\n', stderr);
  open_line_ = false;
}

std::string formatSeconds(double seconds) {
  const auto whole = static_cast<long>(std::ceil(std::max(0.0, seconds)));
  if (whole < 60) return std::to_string(whole) + " s";
  if (whole < 3600) return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
  return std::to_string(whole / 3600) + " h " + std::to_string(whole % 3600 / 60) + " min";
}

std::uint64_t residentBytes() {
  std::ifstream statm("/proc/self/statm");
  std::uint64_t total = 0;
  std::uint64_t resident = 0;
  statm >> total >> resident;
  return resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

std::uint64_t peakResidentBytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

void ignoreBrokenPipes() {
  std::signal(SIGPIPE, SIG_IGN);
}

void stopOnSignals() {
  std::signal(SIGINT, onSignal);
  std::signal(SIGTERM, onSignal);
}

bool stopRequested() {
  return stop_requested;
}

}  // namespace server::cli
