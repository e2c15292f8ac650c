#pragma once
// JPEG by libjpeg-turbo.
#include <optional>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

enum class Subsampling { k420, k422, k444 };
const char* nameOf(Subsampling subsampling);  ///< "4:2:0", "4:2:2", "4:4:4"
/// From such a name, or nothing.
std::optional<Subsampling> subsamplingOf(std::string_view name);

/// `rgb`: 3 channels, each side 1..65500. quality 1..100. Baseline, with Huffman tables made for the picture: the same
/// pixels as with the standard ones, in 13 to 32 % fewer bytes (docs/results/repository.md).
base::Result<base::Bytes> encodeJpeg(const base::Image& rgb, int quality, Subsampling subsampling);
/// RGB. Refuses broken data (also data that libjpeg would only warn about) and sides over `max_side`.
base::Result<base::Image> decodeJpeg(base::ByteView bytes, int max_side = 16384);

}  // namespace repository
