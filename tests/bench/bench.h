#pragma once
// What the benchmarks share: their clock, their command line, and what they do when something fails.
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

/// One line with the program's name, and exit status 1.
[[noreturn]] inline void stop(const std::string& message) {
  std::fprintf(stderr, "%s: %s\n", program_invocation_short_name, message.c_str());
  std::exit(1);
}

/// The value, or stop.
template <class T>
T must(base::Result<T> result) {
  if (!result) stop(result.error().message);
  return std::move(*result);
}
inline void must(const base::Result<void>& result) {
  if (!result) stop(result.error().message);
}

/// CLOCK_MONOTONIC, or one of CPU time.
inline double seconds(clockid_t clock = CLOCK_MONOTONIC) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Of one or more; the higher of the two in the middle.
inline double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

/// Options with a value each, "--name VALUE", and at most one word without. What is not asked for is a wrong usage.
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
  /// Stops outside of least … most.
  template <class Number>
  Number number(const std::string& option, Number otherwise, Number least, Number most) {
    const std::string given = text(option, "");
    if (given.empty()) return otherwise;
    char* end = nullptr;
    const std::uint64_t value = std::strtoull(given.c_str(), &end, 10);
    if (*end != '\0' || given.front() == '-' || value < least || value > most) wrong();
    return static_cast<Number>(value);
  }
  /// After the last option was asked for.
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

/// A directory that goes with the object (but not with stop()).
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
