#include "base/png/png.h"

#include <png.h>

#include <cstring>

#include "base/file.h"

namespace base {
namespace {

// libpng's simplified interface (png.h, "SIMPLIFIED API") keeps its setjmp and longjmp inside libpng, so no C++ frame
// of ours is ever jumped over.

// Largest picture read: 16384 × 16384.
constexpr std::uint64_t kMaxPixels = std::uint64_t{1} << 28;
// A pixel takes at least one bit before deflate, and deflate shrinks at most 1032 to 1 (zlib's documented limit); so a
// file of n bytes holds at most this many pixels per byte. Bounds what a forged header can make us allocate.
constexpr std::uint64_t kMaxPixelsPerFileByte = 8 * 1032;

/// Frees libpng's state on every way out.
struct PngImage : png_image {
  PngImage() : png_image{} { version = PNG_IMAGE_VERSION; }
  ~PngImage() { png_image_free(this); }
  PngImage(const PngImage&) = delete;
  PngImage& operator=(const PngImage&) = delete;
};

Error pngError(const char* action, const PngImage& png) {
  return {ErrorCode::kInvalidInput, std::string("cannot ") + action + " PNG: " + png.message};
}

}  // namespace

Result<void> writePng(const Image& image, const std::string& path) {
  LUMIGRID_CHECK(image.channels == 1 || image.channels == 3 || image.channels == 4);
  LUMIGRID_CHECK(image.width > 0 && image.height > 0);
  PngImage png;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = image.channels == 1 ? PNG_FORMAT_GRAY : image.channels == 3 ? PNG_FORMAT_RGB : PNG_FORMAT_RGBA;

  // Into memory first, so that the file appears whole or not at all. libpng's bound on the size is cheap and never too
  // small.
  Bytes bytes(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = bytes.size();
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, image.pixels.data(), 0, nullptr) == 0)
    return within(path, pngError("write", png));
  return writeFileAtomically(path, ByteView(bytes).first(size));
}

Result<Image> readPng(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, MappedFile::open(path));
  auto image = decodePng(file.bytes());
  return image ? std::move(image) : within(path, image.error());
}

Result<Image> decodePng(ByteView bytes) {
  PngImage png;
  if (png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) == 0) return pngError("read", png);

  const std::uint64_t pixels = std::uint64_t{png.width} * png.height;
  if (pixels > kMaxPixels || pixels > bytes.size() * kMaxPixelsPerFileByte)
    return Error{ErrorCode::kInvalidInput, "PNG claims " + std::to_string(png.width) + " x " +
                                               std::to_string(png.height) +
                                               " pixels, more than its bytes can hold or than we read"};

  // Channels as stored; palettes and 16 bits become 8-bit channels, grey with alpha becomes RGBA.
  const bool color = (png.format & PNG_FORMAT_FLAG_COLOR) != 0;
  const bool alpha = (png.format & PNG_FORMAT_FLAG_ALPHA) != 0;
  const int channels = alpha ? 4 : color ? 3 : 1;
  png.format = alpha ? PNG_FORMAT_RGBA : color ? PNG_FORMAT_RGB : PNG_FORMAT_GRAY;
  Image image(static_cast<int>(png.width), static_cast<int>(png.height), channels);
  if (png_image_finish_read(&png, nullptr, image.pixels.data(), 0, nullptr) == 0) return pngError("read", png);
  return image;
}

}  // namespace base
