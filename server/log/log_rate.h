#pragma once
// Limits how many lines of one kind a second has, so that clients who come and go by the thousand do not fill a disk.
#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace server {

/// Not safe for several threads: the caller locks.
class LogRate {
 public:
  using Clock = std::chrono::steady_clock;
  /// `lines_per_second`: of each kind; 0: no limit.
  explicit LogRate(std::uint32_t lines_per_second) : lines_per_second_(lines_per_second) {}

  /// Whether a line of this kind is written; else it is counted.
  bool admit(std::string_view kind, Clock::time_point now);

  struct Summary {
    std::string kind;
    std::uint64_t left_out = 0;
  };
  /// The kinds of which lines were left out in seconds that are over; each is told once.
  std::vector<Summary> takeSummaries(Clock::time_point now);
  /// When the next summary is due; nothing where no line was left out.
  std::optional<Clock::time_point> nextSummary() const;

 private:
  struct Window {
    Clock::time_point end;
    std::uint32_t admitted = 0;
    std::uint64_t left_out = 0;
  };
  const std::uint32_t lines_per_second_;
  std::map<std::string, Window, std::less<>> windows_;
};

}  // namespace server
