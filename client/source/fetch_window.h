#pragma once
// Says how many bytes may be requested ahead: enough to keep the link busy, and no more, since what is under way cannot
// be overtaken by what a newer plan finds more useful. As BBR does for packets (Cardwell et al. 2016, "BBR:
// Congestion-Based Congestion Control"): the greatest rate of delivery that was seen lately times twice the shortest
// time that an answer took. Over a link that is always busy answers wait for those before them, so that this time grows
// with what is under way; so it is no longer than the shortest that an idle link took, and a little more.
#include <array>
#include <cstddef>
#include <cstdint>

namespace client {

class FetchWindow {
 public:
  /// So much may be under way before anything is known, and later at least so much. Choices.
  static constexpr std::uint64_t kFirstBytes = 64 * 1024, kLeastBytes = 16 * 1024;

  /// The moment of a request or of its answer, in seconds from any zero, and all bytes received until then.
  struct Mark {
    double at = 0.0;
    std::uint64_t received = 0;
    bool was_idle = false;  ///< of a request: nothing that was sent before it was under way
  };
  /// Takes note of an answer that came `now` to a request of `sent`. Times never decrease from call to call.
  void answered(const Mark& sent, const Mark& now);
  /// Bytes that may be under way.
  std::uint64_t bytes() const;
  /// Bytes a second: the greatest rate of delivery that was seen lately; 0 before any was.
  double rate() const;
  /// Bytes a second at which answers of an idle link came, less the time of the quickest, in which nothing comes: the
  /// greatest of the last eight; 0 before two were seen. While little is asked for, rate() is far below it.
  double rateOnceBegun() const;

 private:
  struct Sample {
    double at = -1e9, took = 0.0, rate = 0.0;
  };
  std::array<Sample, 32> samples_{};  // the last ones
  std::size_t count_ = 0;             // taken so far; each takes the place of the oldest
  std::array<Sample, 8> idle_{};      // the last answers of an idle link, likewise
  std::size_t idle_count_ = 0;
};

}  // namespace client
