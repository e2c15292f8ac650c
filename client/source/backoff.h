#pragma once
// Pauses between tries to reach a host that does not answer. They double, up to a largest one, and each is drawn from
// half to one and a half times that: when a server starts anew, its viewers come back spread over time and not all in
// the same moment, and again in the next.
#include <cstdint>
#include <random>

namespace client {

class Backoff {
 public:
  static constexpr double kMinPause = 0.25, kMaxPause = 5.0;  ///< seconds, before they are spread; choices

  explicit Backoff(std::uint32_t seed = randomSeed()) : random_(seed) {}
  static std::uint32_t randomSeed() { return std::random_device{}(); }

  /// Seconds to wait after a failed try; the next pause is longer.
  double nextPause() {
    const double pause = pause_ * std::uniform_real_distribution<double>(0.5, 1.5)(random_);
    pause_ = 2.0 * pause_ < kMaxPause ? 2.0 * pause_ : kMaxPause;
    return pause;
  }
  /// The host answered: the next pause is a short one.
  void reset() { pause_ = kMinPause; }
  /// The host answers, and trying again soon is of no use: the next pause is a longest one.
  void slowDown() { pause_ = kMaxPause; }

 private:
  std::minstd_rand random_;
  double pause_ = kMinPause;
};

}  // namespace client
