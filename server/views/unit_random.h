#pragma once
// Random numbers that are the same everywhere.
#include <cstdint>
#include <random>

namespace server {

/// Random numbers that are the same with every standard library, uniform in [0, 1). std::uniform_real_distribution is
/// another in every library; std::mt19937 is not.
class UnitRandom {
 public:
  explicit UnitRandom(std::uint32_t seed) : random_(seed) {}
  double operator()() { return static_cast<double>(random_()) / 4294967296.0; }

 private:
  std::mt19937 random_;
};

}  // namespace server
