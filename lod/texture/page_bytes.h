#pragma once
// The bytes of a page, and what its first ones say. Private to lod/texture.
#include <cstdint>
#include <string>

#include "base/bytes.h"
#include "base/error.h"

namespace lod::texture {

struct PageHeader {
  bool alpha = false;
  std::uint8_t levels = 1;
  std::uint16_t width = 0, height = 0;
  std::uint16_t triangles = 0;
  std::uint16_t factor = 1;  ///< texels of the picture for one of the page
  std::uint32_t corner_bytes = 0, alpha_bytes = 0, jpeg_bytes = 0;
};

/// From all bytes of a page; their checksum is not looked at.
base::Result<PageHeader> readPageHeader(base::ByteView bytes);

/// Tells what is wrong with the numbers that stand in the table of pages too; null if nothing is.
const char* sizeFault(std::uint16_t width, std::uint16_t height, std::uint8_t levels, std::uint16_t triangles);

/// Errors about a file's bytes name the place, the fault, and what to do.
base::Error damaged(const std::string& problem);

}  // namespace lod::texture
