#pragma once
// Encodes and decodes WebP with alpha, by libwebp. Exact frames and stored tiles are, where nobody asks for JPEG.
#include <cstdint>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

/// As many pixels a side has a WebP at most, by its format.
inline constexpr int kMaxWebpSide = 16383;

/// Encodes RGBA whose colours are not premultiplied, sides 1..kMaxWebpSide; quality is 1..100. Alpha comes back as it
/// is. Colours are kept under alpha 0 too, so give those pixels filler (repository/faces/filler.h). Where `error` is
/// given, it gets the root mean square, 0..1, of what coding changes of the colours over alpha, by the encoder's own
/// account: what lesser chroma takes away is not in it.
base::Result<base::Bytes> encodeWebp(const base::Image& rgba, int quality, float* error = nullptr);
/// The same without loss: every pixel comes back as it is.
base::Result<base::Bytes> encodeWebpWithoutLoss(const base::Image& rgba);

/// Decodes to RGBA, not premultiplied. Refuses broken data, animations, and pictures of more than `max_pixels`, before
/// any memory is taken for them.
base::Result<base::Image> decodeWebp(base::ByteView bytes, std::int64_t max_pixels);

}  // namespace repository
