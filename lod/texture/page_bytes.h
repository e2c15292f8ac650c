#pragma once
// The bytes of a page, and what its first ones say. Private to lod/texture.
#include <glm/glm.hpp>

#include <cstdint>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/texture/page.h"

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

/// A page without its texels.
struct PageLayout {
  glm::ivec2 size{0};
  std::uint32_t levels = 1;  ///< Page::levels
  int factor = 1;            ///< texels of the picture for one of the page
  std::vector<PageTriangle> triangles;
};

/// A page's bytes of its parts: a JPEG of the page's size, and where it has an alpha, that as a zlib stream. Errors:
/// kInvalidInput for what decodePage() would refuse of the layout.
base::Result<base::Bytes> encodePage(const PageLayout& layout, base::ByteView jpeg, base::ByteView alpha = {});

}  // namespace lod::texture
