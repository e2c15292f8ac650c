#pragma once
// Decodes a stored face (repository/faces/face_value.h) into pixels, for viewers, builds and `lumigrid verify`.
#include <cstdint>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "repository/faces/face_value.h"

namespace repository {

/// For an empty flag both images are empty.
struct FacePixels {
  base::Image rgb;
  base::Image mask;  ///< one channel: 255 model, 0 background, where the colours are filler; WebP may be in between
};

/// A picture must be `side` × `side` pixels large; with `side` 0, which exact frames use, it may have any size. Errors:
/// those of decodeFaceValue, decodeJpeg, decodeCoverage and decodeWebp, a mask beside WebP's alpha, and a picture of
/// another size.
base::Result<FacePixels> decodeFacePixels(base::ByteView value, int side);

/// Decodes likewise into RGBA, with the mask as alpha, not premultiplied. The image is
/// empty for an empty flag.
base::Result<base::Image> decodeFaceImage(base::ByteView value, int side);

/// Decodes the WebP of a value that isWebp(), of at most `max_pixels`, into RGBA that is not premultiplied. Errors:
/// those of decodeWebp, and a mask beside the WebP's own alpha.
base::Result<base::Image> decodeWebpImage(const FaceValue& face, std::int64_t max_pixels);

}  // namespace repository
