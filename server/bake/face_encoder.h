#pragma once
// From a rendered face to the value that is stored.
#include <cstdint>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "repository/jpeg.h"

namespace server {

/// A pixel is model when at least half of its samples are.
inline constexpr std::uint8_t kCoverageThreshold = 128;

struct EncodedFace {
  base::Bytes value;  ///< repository::encodeFaceValue
  bool empty = true;
  std::uint64_t jpeg_bytes = 0;
  std::uint64_t coverage_bytes = 0;
};

/// `rgba`: as Rendered::rgba. Without a pixel of model: an empty flag. The same picture gives the same bytes on every
/// thread and machine with the same libjpeg-turbo.
base::Result<EncodedFace> encodeFace(const base::Image& rgba, int quality, repository::Subsampling subsampling);

/// The picture without alpha, what the mask hides replaced by filler that costs a JPEG little: within a block of 8 × 8
/// pixels that holds model, the mean of its model pixels; in other blocks the mean of filled neighbours, spread
/// outward. `mask`: one channel, not 0 = model.
base::Image fillBackground(const base::Image& rgba, const base::Image& mask);

}  // namespace server
