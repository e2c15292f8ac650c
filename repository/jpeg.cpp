#include "repository/jpeg.h"

// libjpeg's header needs these two before it.
#include <cstddef>
#include <cstdio>

#include <jpeglib.h>
#include <turbojpeg.h>

#include <array>
#include <csetjmp>
#include <cstdlib>
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

base::Error jpegError(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, "JPEG: " + what};
}

// --- Encoding: by libjpeg's own interface, since TurboJPEG's (2.1) cannot ask for Huffman tables made for the picture

struct Compressor {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  std::jmp_buf failed{};
  std::array<char, JMSG_LENGTH_MAX> message{};
  unsigned char* bytes = nullptr;  // malloc's
  unsigned long size = 0;

  Compressor() {
    jpeg.err = jpeg_std_error(&errors);
    jpeg.client_data = this;
    errors.error_exit = [](j_common_ptr common) {
      auto* self = static_cast<Compressor*>(common->client_data);
      self->errors.format_message(common, self->message.data());
      std::longjmp(self->failed, 1);  // libjpeg's errors must not return
    };
    errors.output_message = [](j_common_ptr) {};
  }
  ~Compressor() {
    jpeg_destroy_compress(&jpeg);
    std::free(bytes);
  }
  Compressor(const Compressor&) = delete;
  Compressor& operator=(const Compressor&) = delete;
};

void setSubsampling(jpeg_compress_struct& jpeg, Subsampling subsampling) {
  jpeg.comp_info[0].h_samp_factor = subsampling == Subsampling::k444 ? 1 : 2;
  jpeg.comp_info[0].v_samp_factor = subsampling == Subsampling::k420 ? 2 : 1;
  for (int chroma = 1; chroma <= 2; ++chroma)
    jpeg.comp_info[chroma].h_samp_factor = jpeg.comp_info[chroma].v_samp_factor = 1;
}

// False, and a message, on any error. Nothing in here may need a destructor: errors jump out of it.
bool compress(Compressor& to, const base::Image& rgb, int quality, Subsampling subsampling) {
  if (setjmp(to.failed) != 0) return false;
  jpeg_compress_struct& jpeg = to.jpeg;
  jpeg_create_compress(&jpeg);
  jpeg_mem_dest(&jpeg, &to.bytes, &to.size);
  jpeg.image_width = static_cast<JDIMENSION>(rgb.width);
  jpeg.image_height = static_cast<JDIMENSION>(rgb.height);
  jpeg.input_components = 3;
  jpeg.in_color_space = JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  setSubsampling(jpeg, subsampling);
  jpeg.dct_method = JDCT_ISLOW;
  jpeg.optimize_coding = TRUE;

  jpeg_start_compress(&jpeg, TRUE);
  while (jpeg.next_scanline < jpeg.image_height) {
    // libjpeg takes rows it doesn't change as not const.
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
  Compressor compressor;
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

  // A warning (TJERR_WARNING) leaves a picture with grey parts: the data is broken, so it fails like an error.
  // LIMITSCANS stops progressive files made to keep a decoder busy.
  base::Image image(width, height, 3);
  const int failed = tjDecompress2(decompressor.get(), bytes.data(), bytes.size(), image.pixels.data(), width, 0,
                                   height, TJPF_RGB, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS);
  if (failed != 0) return jpegError(tjGetErrorStr2(decompressor.get()));
  return image;
}

}  // namespace repository
