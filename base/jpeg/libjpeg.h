#pragma once
// libjpeg's own interface as the files of base/jpeg use it. Private to base/jpeg.

// libjpeg's header needs these two before it.
#include <cstddef>
#include <cstdio>

#include <jpeglib.h>

#include <array>
#include <csetjmp>

#include "base/bytes.h"

namespace base::libjpeg {

/// libjpeg's errors jump to `failed`, past destructors, so that functions which make its calls hold nothing that needs
/// one. Each call needs an `if (setjmp(failed) != 0)` before it in the same function.
struct Errors {
  jpeg_error_mgr manager{};
  std::jmp_buf failed{};
  std::array<char, JMSG_LENGTH_MAX> message{};

  /// `jpeg`: a jpeg_compress_struct or jpeg_decompress_struct.
  void attach(auto& jpeg) {
    jpeg.err = jpeg_std_error(&manager);
    jpeg.client_data = this;
    manager.error_exit = [](j_common_ptr common) {
      auto* self = static_cast<Errors*>(common->client_data);
      self->manager.format_message(common, self->message.data());
      std::longjmp(self->failed, 1);  // libjpeg's errors must not return
    };
    manager.output_message = [](j_common_ptr) {};
  }
};

/// A compressor's `dest`, set after jpeg_create_compress(): appends what is written to bytes. jpeg_mem_dest() would
/// lose or free them twice where an error comes after they have grown.
class AppendedBytes : public jpeg_destination_mgr {
 public:
  explicit AppendedBytes(Bytes& out) : jpeg_destination_mgr(), out_(out) {
    init_destination = refill;
    empty_output_buffer = [](j_compress_ptr jpeg) -> boolean {
      of(jpeg).append(kBuffer);
      refill(jpeg);
      return TRUE;
    };
    term_destination = [](j_compress_ptr jpeg) { of(jpeg).append(kBuffer - jpeg->dest->free_in_buffer); };
  }
  AppendedBytes(const AppendedBytes&) = delete;
  AppendedBytes& operator=(const AppendedBytes&) = delete;

 private:
  // libjpeg fills the buffer before it is appended. A choice: smaller ones are appended more often.
  static constexpr std::size_t kBuffer = 64 * 1024;

  static AppendedBytes& of(j_compress_ptr jpeg) { return *static_cast<AppendedBytes*>(jpeg->dest); }
  static void refill(j_compress_ptr jpeg) {
    jpeg->dest->next_output_byte = of(jpeg).buffer_.data();
    jpeg->dest->free_in_buffer = kBuffer;
  }
  void append(std::size_t bytes) { out_.insert(out_.end(), buffer_.data(), buffer_.data() + bytes); }

  Bytes& out_;
  std::array<JOCTET, kBuffer> buffer_{};
};

}  // namespace base::libjpeg
