#include "server/metrics/process_metrics.h"

#include <dirent.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <fstream>
#include <limits>
#include <memory>

namespace server {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// The number of entries of a directory of /proc, besides "." and "..".
double countEntries(const char* directory) {
  const std::unique_ptr<DIR, int (*)(DIR*)> open(::opendir(directory), ::closedir);
  if (!open) return kUnknown;
  double count = -2.0;
  while (::readdir(open.get()) != nullptr) ++count;
  return count;
}

double residentBytes() {
  std::ifstream statm("/proc/self/statm");
  double total = 0.0;
  double resident = 0.0;
  if (!(statm >> total >> resident)) return kUnknown;
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

double cpuSeconds() {
  rusage usage{};
  if (::getrusage(RUSAGE_SELF, &usage) != 0) return kUnknown;
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

double maxFiles() {
  rlimit files{};
  if (::getrlimit(RLIMIT_NOFILE, &files) != 0) return kUnknown;
  return files.rlim_cur == RLIM_INFINITY ? std::numeric_limits<double>::infinity()
                                         : static_cast<double>(files.rlim_cur);
}

}  // namespace

void addProcessMetrics(Metrics& metrics) {
  using Kind = Metrics::Kind;
  metrics.read(Kind::kGauge, "process_resident_memory_bytes", "Resident memory in bytes.", {}, residentBytes);
  metrics.read(Kind::kCounter, "process_cpu_seconds_total", "User and system CPU time in seconds.", {}, cpuSeconds);
  // The directory itself is open while it is counted.
  metrics.read(Kind::kGauge, "process_open_fds", "Open file descriptors.", {},
               [] { return countEntries("/proc/self/fd") - 1.0; });
  metrics.read(Kind::kGauge, "process_max_fds", "Most file descriptors that may be open.", {}, maxFiles);
  metrics.read(Kind::kGauge, "process_threads", "Threads.", {}, [] { return countEntries("/proc/self/task"); });
  const double start = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  metrics.read(Kind::kGauge, "process_start_time_seconds", "When the server was started, in Unix seconds.", {},
               [start] { return start; });
  metrics.gauge("lumigrid_build_info", "Always 1; the label tells the version.", {{"version", LUMIGRID_VERSION}})
      .set(1);
}

}  // namespace server
