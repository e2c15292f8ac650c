#pragma once
// The coverage mask beside each image: one bit a pixel, 1 = model, 0 = background; compressed without loss.
// docs/formats/repository.md
#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace repository {

/// Compresses a one-channel image (0 = background, anything else = model), each side 1 to 16384. No bytes when all of
/// it is model.
base::Bytes encodeCoverage(const base::Image& mask);
/// The mask as 0 or 255, width × height, each 1 to 16384 (the caller checks; a grid that Grid::decode took has such).
/// Hostile input is an error, never more memory than width × height plus a constant.
base::Result<base::Image> decodeCoverage(base::ByteView bytes, int width, int height);

}  // namespace repository
