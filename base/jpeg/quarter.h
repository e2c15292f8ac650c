#pragma once
// Means over squares of 4 x 4 pixels, made of a JPEG's coefficients without decoding its pixels. Private to base/jpeg.
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/simd.h"

namespace base::jpeg {

/// The shares that a plane's coefficients add to the means. A coefficient of frequencies (u, v) adds F(u, v) times the
/// mean of its cosines over each square (ITU-T T.81, A.3.3), quantization included.
class QuarterWeights {
 public:
  static constexpr std::size_t kMost = 16;  ///< means in a block
  /// `across` x `down` means in each block, 2 or 4 each. `quant` is in the order of rows, `zigzag` that of coding.
  QuarterWeights(std::span<const std::uint16_t, 64> quant, std::span<const std::uint8_t, 64> zigzag, std::size_t across,
                 std::size_t down);
  std::size_t count() const { return count_; }  ///< of means in a block: 4, 8 or 16
  /// For the coefficients in the order of coding, count() / 4 vectors each: row by row.
  const Float4* all() const { return weights_.data(); }

 private:
  std::size_t count_;
  std::array<Float4, 64 * kMost / 4> weights_{};
};

/// A row of units at a quarter of the picture's size: for each plane `down` rows of the units' samples, -128 to 127
/// where no coefficient was rounded.
struct QuarterRow {
  std::size_t across = 0, down = 0;  ///< samples of a unit
  std::size_t wide = 0;              ///< samples of the row of units
  std::array<std::vector<float>, 3> planes;
};

/// How a reader makes rows, and who gets them. `weights` of the first plane are for 2 x 2 means a block, those of
/// others for as many as a unit has samples.
struct QuarterRows {
  std::vector<QuarterWeights> weights;
  std::size_t blocks_across = 1, blocks_down = 1;  ///< of the first plane in a unit
  std::function<void(std::size_t row, const QuarterRow& samples)> take;
};

}  // namespace base::jpeg
