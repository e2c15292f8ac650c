#include "repository/faces/jpeg_rows.h"

#include <string>

#include "base/check.h"
#include "repository/faces/jpeg_compressor.h"

namespace repository {
namespace {

// libjpeg fills the buffer before it is appended to the picture. A choice: smaller ones are appended more often.
constexpr std::size_t kBuffer = 64 * 1024;

}  // namespace

// Errors jump out of libjpeg's calls, so the functions that make them hold nothing that needs a destructor.
struct JpegRows::Impl : Compressor {
  jpeg_destination_mgr destination{};
  std::array<JOCTET, kBuffer> buffer{};
  base::Bytes* out = nullptr;

  void begin(int width, int height, int quality, Subsampling subsampling) {
    jpeg_create_compress(&jpeg);
    destination.init_destination = refill;
    destination.empty_output_buffer = [](j_compress_ptr common) -> boolean {
      auto* self = implOf(common);
      self->out->insert(self->out->end(), self->buffer.begin(), self->buffer.end());
      refill(common);
      return TRUE;
    };
    destination.term_destination = [](j_compress_ptr common) {
      auto* self = implOf(common);
      const std::size_t used = kBuffer - self->destination.free_in_buffer;
      self->out->insert(self->out->end(), self->buffer.data(), self->buffer.data() + used);
    };
    jpeg.dest = &destination;
    setPicture(jpeg, width, height, quality, subsampling);
    jpeg_start_compress(&jpeg, TRUE);
  }
  void addRows(const base::Image& rgb) {
    for (int y = 0; y < rgb.height; ++y) {
      // libjpeg's interface has no const rows, though it does not change them.
      auto* row = const_cast<JSAMPROW>(rgb.at(0, y));
      jpeg_write_scanlines(&jpeg, &row, 1);
    }
    if (jpeg.next_scanline == jpeg.image_height) jpeg_finish_compress(&jpeg);
  }

  static Impl* implOf(j_compress_ptr common) {
    return static_cast<Impl*>(static_cast<Compressor*>(common->client_data));
  }
  static void refill(j_compress_ptr common) {
    auto* self = implOf(common);
    self->destination.next_output_byte = self->buffer.data();
    self->destination.free_in_buffer = kBuffer;
  }
  base::Error error() const { return {base::ErrorCode::kInvalidInput, std::string("JPEG: ") + message.data()}; }
};

JpegRows::~JpegRows() = default;

base::Result<std::unique_ptr<JpegRows>> JpegRows::begin(int width, int height, int quality, Subsampling subsampling,
                                                        base::Bytes& out) {
  LUMIGRID_CHECK(width > 0 && height > 0 && quality >= 1 && quality <= 100);
  std::unique_ptr<JpegRows> rows(new JpegRows);
  rows->impl_ = std::make_unique<Impl>();
  Impl* impl = rows->impl_.get();
  impl->out = &out;
  if (setjmp(impl->failed) != 0) return impl->error();
  impl->begin(width, height, quality, subsampling);
  return rows;
}

base::Result<void> JpegRows::add(const base::Image& rgb) {
  Impl* impl = impl_.get();
  LUMIGRID_CHECK_EQ(rgb.channels, 3);
  LUMIGRID_CHECK_EQ(static_cast<JDIMENSION>(rgb.width), impl->jpeg.image_width);
  LUMIGRID_CHECK(impl->jpeg.next_scanline + static_cast<JDIMENSION>(rgb.height) <= impl->jpeg.image_height);
  if (setjmp(impl->failed) != 0) return impl->error();
  impl->addRows(rgb);
  return {};
}

}  // namespace repository
