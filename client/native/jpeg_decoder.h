#pragma once
// The native ImageDecoder: libjpeg-turbo on a few threads.
#include <cstdint>
#include <memory>

#include "client/decode.h"

namespace client {

class JpegDecoder : public ImageDecoder {
 public:
  /// `threads` ≥ 1.
  explicit JpegDecoder(unsigned threads);
  ~JpegDecoder() override;
  void submit(std::uint64_t id, base::ByteView value) override;
  std::vector<Decoded> take() override;
  std::size_t pending() const override;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// A face value (repository/face_value.h) as RGBA, alpha 255 on the model and 0 on the background; not premultiplied.
/// Empty for an empty flag.
ImageDecoder::Decoded decodeFaceImage(std::uint64_t id, base::ByteView value);

}  // namespace client
