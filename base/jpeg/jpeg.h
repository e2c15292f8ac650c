#pragma once
// Encodes and decodes JPEG with libjpeg-turbo.
#include <memory>
#include <optional>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "base/image_rows.h"

namespace base {

enum class Subsampling { k420, k422, k444 };
const char* nameOf(Subsampling subsampling);  ///< "4:2:0", "4:2:2", "4:4:4"
/// The inverse of nameOf(); nothing for any other name.
std::optional<Subsampling> subsamplingOf(std::string_view name);

/// `rgb` has 3 channels and sides of 1..65500 pixels; quality is 1..100. The JPEG is a baseline one with Huffman tables
/// made for the picture, which give the same pixels as the standard ones in 13 to 32 % fewer bytes
/// (docs/results/repository.md).
Result<Bytes> encodeJpeg(const Image& rgb, int quality, Subsampling subsampling);

/// Begins a JPEG of 1..65500 pixels a side that is encoded row by row; quality is 1..100. It is a baseline one with the
/// standard Huffman tables, or with `own_tables` those made for the picture, for which libjpeg keeps all its
/// coefficients. The bytes are appended to `out`, which must outlive the result.
Result<std::unique_ptr<ImageRows>> beginJpeg(int width, int height, int quality, Subsampling subsampling, Bytes& out,
                                             bool own_tables = false);
/// The size that a JPEG's header says.
struct JpegSize {
  int width = 0, height = 0;
};
/// Reads the header alone, so that a caller can refuse a size before memory is taken for it.
Result<JpegSize> readJpegSize(ByteView bytes);
/// Decodes to RGB. Refuses broken data, also where libjpeg would only warn, and sides over `max_side` pixels.
Result<Image> decodeJpeg(ByteView bytes, int max_side = 16384);

}  // namespace base
