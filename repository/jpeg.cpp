#include "repository/jpeg.h"

#include <turbojpeg.h>

#include <memory>
#include <string>

#include "base/check.h"

namespace repository {
namespace {

struct CloseHandle {
  void operator()(void* handle) const { tjDestroy(handle); }
};
using Handle = std::unique_ptr<void, CloseHandle>;

// One handle a call: it holds libjpeg's state, may not be shared by threads, and after broken data refuses good data
// too (2.1.5).

int turboSubsampling(Subsampling subsampling) {
  switch (subsampling) {
    case Subsampling::k420:
      return TJSAMP_420;
    case Subsampling::k422:
      return TJSAMP_422;
    case Subsampling::k444:
      return TJSAMP_444;
  }
  return TJSAMP_444;
}

base::Error jpegError(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, "JPEG: " + what};
}

}  // namespace

base::Result<base::Bytes> encodeJpeg(const base::Image& rgb, int quality, Subsampling subsampling) {
  LUMIGRID_CHECK_EQ(rgb.channels, 3);
  LUMIGRID_CHECK(quality >= 1 && quality <= 100);
  if (rgb.empty()) return jpegError("an image without pixels cannot be encoded");
  const Handle compressor(tjInitCompress());
  if (compressor == nullptr) return base::Error{base::ErrorCode::kNoSpace, "JPEG: no memory for an encoder"};

  const int samples = turboSubsampling(subsampling);
  const unsigned long limit = tjBufSize(rgb.width, rgb.height, samples);
  if (limit == static_cast<unsigned long>(-1))
    return jpegError("an image of " + std::to_string(rgb.width) + " x " + std::to_string(rgb.height) +
                     " cannot be encoded");

  base::Bytes bytes(limit);
  unsigned char* out = bytes.data();
  unsigned long size = limit;
  const int failed = tjCompress2(compressor.get(), rgb.pixels.data(), rgb.width, 0, rgb.height, TJPF_RGB, &out, &size,
                                 samples, quality, TJFLAG_NOREALLOC | TJFLAG_ACCURATEDCT);
  if (failed != 0) return jpegError(tjGetErrorStr2(compressor.get()));
  bytes.resize(size);
  bytes.shrink_to_fit();
  return bytes;
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

  // A warning (TJERR_WARNING) leaves a picture with grey parts: the data is broken, so it fails like an error.
  // LIMITSCANS stops progressive files made to keep a decoder busy.
  base::Image image(width, height, 3);
  const int failed = tjDecompress2(decompressor.get(), bytes.data(), bytes.size(), image.pixels.data(), width, 0,
                                   height, TJPF_RGB, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS);
  if (failed != 0) return jpegError(tjGetErrorStr2(decompressor.get()));
  return image;
}

}  // namespace repository
