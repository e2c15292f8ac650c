#pragma once
// Encodes and decodes JPEG with libjpeg-turbo.
#include <optional>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

enum class Subsampling { k420, k422, k444 };
const char* nameOf(Subsampling subsampling);  ///< "4:2:0", "4:2:2", "4:4:4"
/// The inverse of nameOf(); nothing for any other name.
std::optional<Subsampling> subsamplingOf(std::string_view name);

/// `rgb` has 3 channels and sides of 1..65500 pixels; quality is 1..100. The JPEG is a baseline one with Huffman tables
/// made for the picture, which give the same pixels as the standard ones in 13 to 32 % fewer bytes
/// (docs/results/repository.md).
base::Result<base::Bytes> encodeJpeg(const base::Image& rgb, int quality, Subsampling subsampling);
/// Decodes to RGB. Refuses broken data, also where libjpeg would only warn, and sides over `max_side` pixels.
base::Result<base::Image> decodeJpeg(base::ByteView bytes, int max_side = 16384);

}  // namespace repository
