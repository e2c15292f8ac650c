#pragma once
// PNG files by libpng.
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace base {

/// 1, 3 or 4 channels; the file appears whole or not at all.
Result<void> writePng(const Image& image, const std::string& path);
/// 8 bits per channel: 1, 3 or 4 channels as stored (palettes expanded).
Result<Image> readPng(const std::string& path);
/// Decodes a PNG in memory; errors do not name a file.
Result<Image> decodePng(ByteView bytes);

}  // namespace base
