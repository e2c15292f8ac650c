#include "repository/faces/jpeg_rows.h"

#include <string>

#include "base/check.h"
#include "repository/faces/jpeg_compressor.h"

namespace repository {
namespace {

constexpr std::size_t kBuffer = 64 * 1024;

}  // namespace

// Errors jump out of the calls of libjpeg: what makes them has nothing that a destructor must end.
struct JpegRows::State : Compressor {
  jpeg_destination_mgr destination{};
  std::array<JOCTET, kBuffer> buffer{};
  base::Bytes* out = nullptr;

  void begin(int width, int height, int quality, Subsampling subsampling) {
    jpeg_create_compress(&jpeg);
    destination.init_destination = refill;
    destination.empty_output_buffer = [](j_compress_ptr common) -> boolean {
      auto* self = stateOf(common);
      self->out->insert(self->out->end(), self->buffer.begin(), self->buffer.end());
      refill(common);
      return TRUE;
    };
    destination.term_destination = [](j_compress_ptr common) {
      auto* self = stateOf(common);
      const std::size_t used = kBuffer - self->destination.free_in_buffer;
      self->out->insert(self->out->end(), self->buffer.data(), self->buffer.data() + used);
    };
    jpeg.dest = &destination;
    setPicture(jpeg, width, height, quality, subsampling);
    jpeg_start_compress(&jpeg, TRUE);
  }
  void add(const base::Image& rgb) {
    for (int y = 0; y < rgb.height; ++y) {
      // libjpeg takes rows it doesn't change as not const.
      auto* row = const_cast<JSAMPROW>(rgb.at(0, y));
      jpeg_write_scanlines(&jpeg, &row, 1);
    }
    if (jpeg.next_scanline == jpeg.image_height) jpeg_finish_compress(&jpeg);
  }

  static State* stateOf(j_compress_ptr common) {
    return static_cast<State*>(static_cast<Compressor*>(common->client_data));
  }
  static void refill(j_compress_ptr common) {
    auto* self = stateOf(common);
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
  rows->state_ = std::make_unique<State>();
  State* state = rows->state_.get();
  state->out = &out;
  if (setjmp(state->failed) != 0) return state->error();
  state->begin(width, height, quality, subsampling);
  return rows;
}

base::Result<void> JpegRows::add(const base::Image& rgb) {
  State* state = state_.get();
  LUMIGRID_CHECK_EQ(rgb.channels, 3);
  LUMIGRID_CHECK_EQ(static_cast<JDIMENSION>(rgb.width), state->jpeg.image_width);
  LUMIGRID_CHECK(state->jpeg.next_scanline + static_cast<JDIMENSION>(rgb.height) <= state->jpeg.image_height);
  if (setjmp(state->failed) != 0) return state->error();
  state->add(rgb);
  return {};
}

}  // namespace repository
