#pragma once
// Decodes whatever picture a server sends: a stored face, or an exact frame, which may be WebP.
#include <cstdint>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

/// Decodes a face value whose picture is JPEG or WebP, told by its first bytes, into RGBA that is not premultiplied;
/// alpha is coverage: 0 or 255 beside a JPEG, 0..255 in WebP. The image is empty for an empty flag. Errors: those of
/// decodeFaceImage; WebP of more than `max_pixels` or with a mask beside its alpha.
base::Result<base::Image> decodeFrameImage(base::ByteView value, std::int64_t max_pixels);

}  // namespace repository
