#pragma once
// PNG files by libpng.
#include <memory>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "base/image_rows.h"

namespace base {

/// 1, 3 or 4 channels; the file appears whole or not at all.
Result<void> writePng(const Image& image, const std::string& path);
/// Begins a PNG that is encoded row by row: width, height 1 or more pixels; 3 or 4 channels of 8 bits. The bytes are
/// appended to `out`, which must outlive the result.
Result<std::unique_ptr<ImageRows>> beginPng(int width, int height, int channels, Bytes& out);
/// 8 bits per channel: 1, 3 or 4 channels as stored (palettes expanded).
Result<Image> readPng(const std::string& path);
/// Decodes a PNG in memory; errors do not name a file.
Result<Image> decodePng(ByteView bytes);

}  // namespace base
