#pragma once
// The benchmarks share this clock, command line and way to stop when something fails.
#include <time.h>
#include <unistd.h>
#include <cerrno>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"

namespace bench {

/// Prints one line with the program's name and ends with exit status 1.
[[noreturn]] inline void stop(const std::string& message) {
  std::fprintf(stderr, "%s: %s\n", program_invocation_short_name, message.c_str());
  std::exit(1);
}

/// Returns the value, or stops with the error.
template <class T>
T must(base::Result<T> result) {
  if (!result) stop(result.error().message);
  return std::move(*result);
}
inline void must(const base::Result<void>& result) {
  if (!result) stop(result.error().message);
}

/// Reads CLOCK_MONOTONIC, or a clock of CPU time.
inline double seconds(clockid_t clock = CLOCK_MONOTONIC) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Takes one value or more; of an even number it returns the higher of the two in the middle.
inline double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

/// Reads options with a value each, "--name VALUE", and at most one word without a dash. An option that nobody asks for
/// is a wrong usage.
class Arguments {
 public:
  /// `usage`: printed where something is wrong.
  Arguments(int argc, char** argv, std::string usage) : usage_(std::move(usage)) {
    for (int i = 1; i < argc; ++i) {
      const std::string word = argv[i];
      if (!word.starts_with("--")) {
        if (!input_.empty()) wrong();
        input_ = word;
      } else {
        if (i + 1 == argc) wrong();
        options_[word] = argv[++i];
      }
    }
  }
  const std::string& input() const { return input_; }  ///< "": none
  std::string text(const std::string& option, const std::string& otherwise) {
    const auto given = options_.extract(option);
    return given ? given.mapped() : otherwise;
  }
  /// Stops when the value is below `min` or above `max`.
  template <class Number>
  Number number(const std::string& option, Number otherwise, Number min, Number max) {
    const std::string given = text(option, "");
    if (given.empty()) return otherwise;
    char* end = nullptr;
    const std::uint64_t value = std::strtoull(given.c_str(), &end, 10);
    if (*end != '\0' || given.front() == '-' || value < min || value > max) wrong();
    return static_cast<Number>(value);
  }
  /// Must be called after the last option was asked for.
  void finish() const {
    if (!options_.empty()) wrong();
  }
  [[noreturn]] void wrong() const {
    std::fprintf(stderr, "usage: %s %s\n", program_invocation_short_name, usage_.c_str());
    std::exit(2);
  }

 private:
  std::string usage_, input_;
  std::map<std::string, std::string> options_;
};

/// The directory is removed with the object, but not by stop().
class WorkDirectory {
 public:
  explicit WorkDirectory(const std::string& parent = std::filesystem::temp_directory_path().string())
      : path_(parent + "/" + program_invocation_short_name + "_" + std::to_string(::getpid())) {
    std::filesystem::create_directories(path_);
  }
  ~WorkDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  WorkDirectory(const WorkDirectory&) = delete;
  WorkDirectory& operator=(const WorkDirectory&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  const std::string path_;
};

}  // namespace bench
