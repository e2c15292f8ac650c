#pragma once
// The native ImageDecoder uses libjpeg-turbo on a few threads.
#include <cstdint>
#include <memory>

#include "client/viewer/decode.h"

namespace client {

class JpegDecoder : public ImageDecoder {
 public:
  /// `threads` ≥ 1.
  explicit JpegDecoder(unsigned threads);
  ~JpegDecoder() override;
  void submit(std::uint64_t id, base::ByteView coded) override;
  std::vector<DecodedImage> takeDecoded() override;
  std::size_t pending() const override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Decodes with repository::decodeFaceImage, images of any size.
ImageDecoder::DecodedImage decodeFaceImage(std::uint64_t id, base::ByteView coded);

}  // namespace client
