#include "base/jpeg/quarter.h"

#include <cmath>
#include <numbers>

#include "base/check.h"

namespace base::jpeg {
namespace {

// The mean of the cosine of frequency u over the pixels [first, first + count) of eight, times C(u) / 2.
double meanCosine(std::size_t u, std::size_t first, std::size_t count) {
  double sum = 0.0;
  for (std::size_t x = first; x < first + count; ++x)
    sum += std::cos(static_cast<double>((2 * x + 1) * u) * std::numbers::pi / 16.0);
  return 0.5 * (u == 0 ? std::numbers::sqrt2 / 2.0 : 1.0) * sum / static_cast<double>(count);
}

}  // namespace

QuarterWeights::QuarterWeights(std::span<const std::uint16_t, 64> quant, std::span<const std::uint8_t, 64> zigzag,
                               std::size_t across, std::size_t down)
    : count_(across * down) {
  LUMIGRID_CHECK((across == 2 || across == 4) && (down == 2 || down == 4));
  for (std::size_t k = 0; k < 64; ++k) {
    const std::size_t u = zigzag[k] % 8, v = zigzag[k] / 8;
    for (std::size_t i = 0; i < count_; ++i) {
      const double weight = quant[zigzag[k]] * meanCosine(u, i % across * 8 / across, 8 / across) *
                            meanCosine(v, i / across * 8 / down, 8 / down);
      weights_[(k * count_ + i) / 4][i % 4] = static_cast<float>(weight);
    }
  }
}

}  // namespace base::jpeg
