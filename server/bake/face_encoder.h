#pragma once
// Encodes a rendered face as the value that is stored (repository/faces/face_image.h decodes it). A pixel is model when
// at least half of its samples are: base::kCoverageThreshold.
#include <cstdint>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "repository/faces/jpeg.h"

namespace server {

struct EncodedFace {
  base::Bytes value;  ///< repository::encodeFaceValue
  bool empty = true;
  std::uint64_t jpeg_bytes = 0;
  std::uint64_t coverage_bytes = 0;
};

/// A mask of one channel: 255 where a pixel of `rgba` (as RenderedPicture::rgba) is stored as model, else 0.
base::Image coverageMask(const base::Image& rgba);
/// Tells whether any pixel is stored as model. If not, the face is an empty flag.
bool showsModel(const base::Image& rgba);

/// `rgba`: as RenderedPicture::rgba. Without a pixel of model the value is an empty flag. The same picture gives the
/// same bytes on every thread and machine with the same libjpeg-turbo.
base::Result<EncodedFace> encodeFace(const base::Image& rgba, int quality, repository::Subsampling subsampling);

}  // namespace server
