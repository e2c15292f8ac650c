#pragma once
// Measures wall time and the CPU time of all threads together.
#include <time.h>

#include <chrono>

namespace base {

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }
  double cpuSeconds() const { return processSeconds() - cpu_start_; }

 private:
  static double processSeconds() {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  }
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  double cpu_start_ = processSeconds();
};

}  // namespace base
