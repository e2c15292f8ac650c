#pragma once
// JPEG by libjpeg-turbo.
#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

enum class Subsampling { k420, k422, k444 };

/// `rgb`: 3 channels. quality 1..100.
base::Result<base::Bytes> encodeJpeg(const base::Image& rgb, int quality, Subsampling subsampling);
/// RGB. Refuses broken data (also data that libjpeg would only warn about) and sides over `max_side`.
base::Result<base::Image> decodeJpeg(base::ByteView bytes, int max_side = 16384);

}  // namespace repository
