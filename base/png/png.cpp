#include "base/png/png.h"

#include <png.h>

#include <array>
#include <csetjmp>
#include <cstring>

#include "base/file.h"

namespace base {
namespace {

// Whole pictures use libpng's simplified interface (png.h, "SIMPLIFIED API"), which keeps its setjmp and longjmp inside
// libpng, so no C++ frame of ours is ever jumped over.

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

// zlib's level. Measured on half-transparent pictures of scans: 3 gives files 5 % larger than 6, in half the time.
constexpr int kLevel = 3;

// libpng leaves failing calls by longjmp, so the functions that call it have no objects with destructors.
class RowEncoder final : public ImageRows {
 public:
  RowEncoder(int width, int height, int channels, Bytes& out)
      : width_(width), height_(height), channels_(channels), out_(out) {
    png_ = png_create_write_struct(PNG_LIBPNG_VER_STRING, this, onError, [](png_structp, png_const_charp) {});
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  ~RowEncoder() override { png_destroy_write_struct(&png_, &info_); }
  RowEncoder(const RowEncoder&) = delete;
  RowEncoder& operator=(const RowEncoder&) = delete;

  Result<void> start() {
    if (info_ == nullptr) return Error{ErrorCode::kNoSpace, "cannot write PNG: no memory for an encoder"};
    if (setjmp(png_jmpbuf(png_)) != 0) return error();
    png_set_write_fn(png_, this, append, [](png_structp) {});
    png_set_IHDR(png_, info_, static_cast<png_uint_32>(width_), static_cast<png_uint_32>(height_), 8,
                 channels_ == 4 ? PNG_COLOR_TYPE_RGBA : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png_, kLevel);
    png_write_info(png_, info_);
    return {};
  }

  Result<void> add(const Image& rows) override {
    LUMIGRID_CHECK_EQ(rows.width, width_);
    LUMIGRID_CHECK_EQ(rows.channels, channels_);
    LUMIGRID_CHECK(next_row_ + rows.height <= height_);
    if (setjmp(png_jmpbuf(png_)) != 0) return error();
    for (int y = 0; y < rows.height; ++y) png_write_row(png_, rows.at(0, y));
    next_row_ += rows.height;
    if (next_row_ == height_) png_write_end(png_, info_);
    return {};
  }

 private:
  static void onError(png_structp png, png_const_charp text) {
    auto* self = static_cast<RowEncoder*>(png_get_error_ptr(png));
    std::strncpy(self->message_.data(), text, self->message_.size() - 1);
    png_longjmp(png, 1);
  }
  static void append(png_structp png, png_bytep bytes, std::size_t count) {
    auto* self = static_cast<RowEncoder*>(png_get_io_ptr(png));
    self->out_.insert(self->out_.end(), bytes, bytes + count);
  }
  Error error() const { return {ErrorCode::kInvalidInput, std::string("cannot write PNG: ") + message_.data()}; }

  const int width_, height_, channels_;
  Bytes& out_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  int next_row_ = 0;
  std::array<char, 160> message_{};
};

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

Result<std::unique_ptr<ImageRows>> beginPng(int width, int height, int channels, Bytes& out) {
  LUMIGRID_CHECK(width > 0 && height > 0 && (channels == 3 || channels == 4));
  auto rows = std::make_unique<RowEncoder>(width, height, channels, out);
  LUMIGRID_TRY(rows->start());
  return std::unique_ptr<ImageRows>(std::move(rows));
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

  // Deep pictures that do not say what their samples mean are sRGB like all others; libpng would take them as linear.
  png.flags |= PNG_IMAGE_FLAG_16BIT_sRGB;
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
