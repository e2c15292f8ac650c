#include "repository/faces/jpeg.h"

#include <turbojpeg.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "base/check.h"
#include "repository/faces/jpeg_compressor.h"

namespace repository {
namespace {

struct CloseHandle {
  void operator()(void* handle) const { tjDestroy(handle); }
};
using Handle = std::unique_ptr<void, CloseHandle>;

// Each call makes its own handle: threads may not share one, and in version 2.1.5 a handle that met broken data refuses
// good data afterwards.

base::Error jpegError(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "JPEG: " + problem};
}

// --- Encoding. It uses libjpeg's own interface, since TurboJPEG 2.1 cannot make Huffman tables for the picture.

/// Compresses into memory that libjpeg allocates with malloc.
struct MemoryCompressor : Compressor {
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  ~MemoryCompressor() { std::free(bytes); }
};

// Returns false and leaves a message on any error. Errors jump out of this function, so nothing in it may need a
// destructor.
bool compress(MemoryCompressor& to, const base::Image& rgb, int quality, Subsampling subsampling) {
  if (setjmp(to.failed) != 0) return false;
  jpeg_compress_struct& jpeg = to.jpeg;
  jpeg_create_compress(&jpeg);
  jpeg_mem_dest(&jpeg, &to.bytes, &to.size);
  setPicture(jpeg, rgb.width, rgb.height, quality, subsampling);
  jpeg.optimize_coding = TRUE;

  jpeg_start_compress(&jpeg, TRUE);
  while (jpeg.next_scanline < jpeg.image_height) {
    // libjpeg's interface has no const rows, though it does not change them.
    auto* row = const_cast<JSAMPROW>(rgb.at(0, static_cast<int>(jpeg.next_scanline)));
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  return true;
}

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

base::Result<base::Bytes> encodeJpeg(const base::Image& rgb, int quality, Subsampling subsampling) {
  LUMIGRID_CHECK_EQ(rgb.channels, 3);
  LUMIGRID_CHECK(quality >= 1 && quality <= 100);
  if (rgb.empty()) return jpegError("an image without pixels cannot be encoded");
  MemoryCompressor compressor;
  if (!compress(compressor, rgb, quality, subsampling)) return jpegError(compressor.message.data());
  return base::Bytes(compressor.bytes, compressor.bytes + compressor.size);
}

base::Result<base::Image> decodeJpeg(base::ByteView bytes, int max_side) {
  const Handle decompressor(tjInitDecompress());
  if (decompressor == nullptr) return base::Error{base::ErrorCode::kNoSpace, "JPEG: no memory for a decoder"};

  int width = 0;
  int height = 0;
  int samples = 0;
  int colors = 0;
  if (bytes.empty() ||
      tjDecompressHeader3(decompressor.get(), bytes.data(), bytes.size(), &width, &height, &samples, &colors) != 0) {
    return jpegError(bytes.empty() ? "no bytes" : tjGetErrorStr2(decompressor.get()));
  }
  if (width < 1 || height < 1 || width > max_side || height > max_side) {
    return jpegError(std::to_string(width) + " x " + std::to_string(height) + " pixels; the largest side taken is " +
                     std::to_string(max_side));
  }

  // A warning (TJERR_WARNING) means broken data and a picture with grey parts, so it fails like an error. LIMITSCANS
  // stops progressive files that are made to keep a decoder busy.
  base::Image image(width, height, 3);
  const int failed = tjDecompress2(decompressor.get(), bytes.data(), bytes.size(), image.pixels.data(), width, 0,
                                   height, TJPF_RGB, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS);
  if (failed != 0) return jpegError(tjGetErrorStr2(decompressor.get()));
  return image;
}

}  // namespace repository
