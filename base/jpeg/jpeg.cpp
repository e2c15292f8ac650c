#include "base/jpeg/jpeg.h"

#include <turbojpeg.h>

#include <string>

#include "base/check.h"
#include "base/jpeg/libjpeg.h"

namespace base {
namespace {

struct CloseHandle {
  void operator()(void* handle) const { tjDestroy(handle); }
};
using Handle = std::unique_ptr<void, CloseHandle>;

// Each call makes its own handle: threads may not share one, and in version 2.1.5 a handle that met broken data refuses
// good data afterwards.

Error jpegError(const std::string& problem) {
  return {ErrorCode::kInvalidInput, "JPEG: " + problem};
}

// --- Encoding. It uses libjpeg's own interface, since TurboJPEG 2.1 can neither make Huffman tables for the picture
// nor encode row by row.

class RowEncoder final : public ImageRows {
 public:
  explicit RowEncoder(Bytes& out) : destination_(out) { errors_.attach(jpeg_); }
  ~RowEncoder() override { jpeg_destroy_compress(&jpeg_); }
  RowEncoder(const RowEncoder&) = delete;
  RowEncoder& operator=(const RowEncoder&) = delete;

  Result<void> start(int width, int height, int quality, Subsampling subsampling, bool own_tables) {
    if (setjmp(errors_.failed) != 0) return jpegError(errors_.message.data());
    jpeg_create_compress(&jpeg_);
    jpeg_.dest = &destination_;
    jpeg_.image_width = static_cast<JDIMENSION>(width);
    jpeg_.image_height = static_cast<JDIMENSION>(height);
    jpeg_.input_components = 3;
    jpeg_.in_color_space = JCS_RGB;
    jpeg_set_defaults(&jpeg_);
    jpeg_set_quality(&jpeg_, quality, TRUE);
    jpeg_.comp_info[0].h_samp_factor = subsampling == Subsampling::k444 ? 1 : 2;
    jpeg_.comp_info[0].v_samp_factor = subsampling == Subsampling::k420 ? 2 : 1;
    for (int chroma = 1; chroma <= 2; ++chroma)
      jpeg_.comp_info[chroma].h_samp_factor = jpeg_.comp_info[chroma].v_samp_factor = 1;
    jpeg_.dct_method = JDCT_ISLOW;
    jpeg_.optimize_coding = own_tables ? TRUE : FALSE;
    jpeg_start_compress(&jpeg_, TRUE);
    return {};
  }

  Result<void> add(const Image& rgb) override {
    LUMIGRID_CHECK_EQ(rgb.channels, 3);
    LUMIGRID_CHECK_EQ(static_cast<JDIMENSION>(rgb.width), jpeg_.image_width);
    LUMIGRID_CHECK(jpeg_.next_scanline + static_cast<JDIMENSION>(rgb.height) <= jpeg_.image_height);
    if (setjmp(errors_.failed) != 0) return jpegError(errors_.message.data());
    for (int y = 0; y < rgb.height; ++y) {
      // libjpeg's interface has no const rows, though it does not change them.
      auto* row = const_cast<JSAMPROW>(rgb.at(0, y));
      jpeg_write_scanlines(&jpeg_, &row, 1);
    }
    if (jpeg_.next_scanline == jpeg_.image_height) jpeg_finish_compress(&jpeg_);
    return {};
  }

 private:
  jpeg_compress_struct jpeg_{};
  libjpeg::Errors errors_;
  libjpeg::AppendedBytes destination_;
};

}  // namespace

const char* nameOf(Subsampling subsampling) {
  switch (subsampling) {
    case Subsampling::k420:
      return "4:2:0";
    case Subsampling::k422:
      return "4:2:2";
    case Subsampling::k444:
      return "4:4:4";
  }
  return "";
}

std::optional<Subsampling> subsamplingOf(std::string_view name) {
  for (const Subsampling one : {Subsampling::k420, Subsampling::k422, Subsampling::k444})
    if (name == nameOf(one)) return one;
  return std::nullopt;
}

Result<std::unique_ptr<ImageRows>> beginJpeg(int width, int height, int quality, Subsampling subsampling, Bytes& out,
                                             bool own_tables) {
  LUMIGRID_CHECK(width > 0 && height > 0 && quality >= 1 && quality <= 100);
  auto rows = std::make_unique<RowEncoder>(out);
  LUMIGRID_TRY(rows->start(width, height, quality, subsampling, own_tables));
  return std::unique_ptr<ImageRows>(std::move(rows));
}

Result<Bytes> encodeJpeg(const Image& rgb, int quality, Subsampling subsampling) {
  if (rgb.empty()) return jpegError("an image without pixels cannot be encoded");
  Bytes bytes;
  LUMIGRID_ASSIGN_OR_RETURN(auto rows, beginJpeg(rgb.width, rgb.height, quality, subsampling, bytes, true));
  LUMIGRID_TRY(rows->add(rgb));
  return bytes;
}

namespace {

Result<JpegSize> readSize(void* decompressor, ByteView bytes) {
  JpegSize size;
  int samples = 0;
  int colors = 0;
  if (bytes.empty()) return jpegError("no bytes");
  if (tjDecompressHeader3(decompressor, bytes.data(), bytes.size(), &size.width, &size.height, &samples, &colors) != 0)
    return jpegError(tjGetErrorStr2(decompressor));
  return size;
}

Result<Handle> makeDecompressor() {
  Handle decompressor(tjInitDecompress());
  if (decompressor == nullptr) return Error{ErrorCode::kNoSpace, "JPEG: no memory for a decoder"};
  return decompressor;
}

}  // namespace

Result<JpegSize> readJpegSize(ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto decompressor, makeDecompressor());
  return readSize(decompressor.get(), bytes);
}

Result<Image> decodeJpeg(ByteView bytes, int max_side) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto decompressor, makeDecompressor());
  LUMIGRID_ASSIGN_OR_RETURN(const auto size, readSize(decompressor.get(), bytes));
  const auto [width, height] = size;
  if (width < 1 || height < 1 || width > max_side || height > max_side) {
    return jpegError(std::to_string(width) + " x " + std::to_string(height) + " pixels; the largest side taken is " +
                     std::to_string(max_side));
  }

  // A warning (TJERR_WARNING) means broken data and a picture with grey parts, so it fails like an error. LIMITSCANS
  // stops progressive files that are made to keep a decoder busy.
  Image image(width, height, 3);
  const int failed = tjDecompress2(decompressor.get(), bytes.data(), bytes.size(), image.pixels.data(), width, 0,
                                   height, TJPF_RGB, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS);
  if (failed != 0) return jpegError(tjGetErrorStr2(decompressor.get()));
  return image;
}

}  // namespace base
