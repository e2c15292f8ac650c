#pragma once
// Says how many bytes may be requested ahead: enough to keep the link busy, and no more, since what is under way cannot
// be overtaken by what a newer plan finds more useful. As BBR does for packets (Cardwell et al. 2016, "BBR:
// Congestion-Based Congestion Control"): twice the greatest rate of delivery that was seen lately times the shortest
// time that an answer took.
#include <array>
#include <cstddef>
#include <cstdint>

namespace client {

class FetchWindow {
 public:
  /// At least this much may be under way, and at first. A choice: 0.1 s at 5 Mbit/s.
  static constexpr std::uint64_t kLeastBytes = 64 * 1024;

  /// A request was sent when `received` bytes had come in all.
  struct Mark {
    double at = 0.0;
    std::uint64_t received = 0;
  };
  /// Takes note of an answer to the request sent at `sent`. Seconds from any zero, never decreasing.
  void answered(const Mark& sent, const Mark& now);
  std::uint64_t bytes() const;

 private:
  struct Sample {
    double at = -1e9, took = 0.0, rate = 0.0;
  };
  std::array<Sample, 32> samples_{};  // the last ones
  std::size_t next_ = 0;              // the oldest of them
  double now_ = 0.0;
};

}  // namespace client
