#pragma once
// Compresses the coverage mask beside each image without loss: one bit a pixel, 1 = model, 0 = background
// (docs/formats/repository.md, "Coverage mask").
#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

/// Compresses a one-channel image (0 = background, anything else = model) whose sides are 1 to 16384 pixels. A mask
/// that is all model becomes no bytes.
base::Bytes encodeCoverage(const base::Image& mask);
/// Returns the mask as 0 or 255, width × height pixels. The caller makes sure that both are 1 to 16384, as Grid::decode
/// does for faces. Hostile bytes give an error and never take more memory than width × height plus a constant.
base::Result<base::Image> decodeCoverage(base::ByteView bytes, int width, int height);

}  // namespace repository
