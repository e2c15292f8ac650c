#pragma once
// A stored face (repository/face_value.h) as pixels: what viewers, builds and `verify` make of its bytes.
#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

/// Both empty for an empty flag.
struct FacePixels {
  base::Image rgb;
  base::Image mask;  ///< one channel: 255 model, 0 background, where the colours are filler
};

/// `side`: that width and height alone are taken; 0: any, as exact frames have. Errors: what decodeFaceValue,
/// decodeJpeg and decodeCoverage refuse, and other sides.
base::Result<FacePixels> decodeFacePixels(base::ByteView value, int side);

/// The same as RGBA, alpha 255 on the model and 0 on the background, not premultiplied; empty for an empty flag.
base::Result<base::Image> decodeFaceImage(base::ByteView value, int side);

}  // namespace repository
