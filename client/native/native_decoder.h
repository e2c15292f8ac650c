#pragma once
// The native ImageDecoder uses libjpeg-turbo and libwebp on a few threads.
#include <cstdint>
#include <limits>
#include <mutex>
#include <vector>

#include "base/parallel.h"
#include "client/viewer/decode.h"

namespace client {

class NativeDecoder : public ImageDecoder {
 public:
  /// `threads` ≥ 1.
  explicit NativeDecoder(unsigned threads) : pool_(threads, std::numeric_limits<std::size_t>::max()) {}
  void submit(std::uint64_t id, base::ByteView coded) override;
  std::vector<DecodedImage> takeDecoded() override;
  std::size_t pending() const override;

 private:
  mutable std::mutex mutex_;
  std::vector<DecodedImage> done_;
  std::size_t pending_ = 0;  // submitted and not taken yet
  base::ThreadPool pool_;    // last member, so that its threads end before the members they write to
};

/// Decodes with repository::decodeFrameImage; an error is one line.
ImageDecoder::DecodedImage decodeFaceImage(std::uint64_t id, base::ByteView coded);

}  // namespace client
