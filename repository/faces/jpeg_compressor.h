#pragma once
// Holds libjpeg's state while a picture is encoded and turns its errors into a message. Private to jpeg.cpp and
// jpeg_rows.cpp.

// libjpeg's header needs these two before it.
#include <cstddef>
#include <cstdio>

#include <jpeglib.h>

#include <array>
#include <csetjmp>

#include "repository/faces/jpeg.h"

namespace repository {

/// Every call of libjpeg needs an `if (setjmp(failed) != 0)` before it: errors jump there, past destructors.
struct Compressor {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  std::jmp_buf failed{};
  std::array<char, JMSG_LENGTH_MAX> message{};

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
  ~Compressor() { jpeg_destroy_compress(&jpeg); }
  Compressor(const Compressor&) = delete;
  Compressor& operator=(const Compressor&) = delete;
};

/// Sets all parameters that decide the bytes, except the Huffman tables, for RGB pixels. Call it after
/// jpeg_create_compress and after setting the destination.
inline void setPicture(jpeg_compress_struct& jpeg, int width, int height, int quality, Subsampling subsampling) {
  jpeg.image_width = static_cast<JDIMENSION>(width);
  jpeg.image_height = static_cast<JDIMENSION>(height);
  jpeg.input_components = 3;
  jpeg.in_color_space = JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  jpeg.comp_info[0].h_samp_factor = subsampling == Subsampling::k444 ? 1 : 2;
  jpeg.comp_info[0].v_samp_factor = subsampling == Subsampling::k420 ? 2 : 1;
  for (int chroma = 1; chroma <= 2; ++chroma)
    jpeg.comp_info[chroma].h_samp_factor = jpeg.comp_info[chroma].v_samp_factor = 1;
  jpeg.dct_method = JDCT_ISLOW;
}

}  // namespace repository
