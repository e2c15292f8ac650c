#pragma once
// The browser's image decoder sends coded faces to the page's workers and gets pixels back (client/web/site/decode.js).
// Main thread only.
#include <cstdint>
#include <utility>
#include <vector>

#include "client/viewer/decode.h"
#include "client/web/only_one.h"

namespace client {

class WebDecoder final : public ImageDecoder, public OnlyOne<WebDecoder> {
 public:
  void submit(std::uint64_t id, base::ByteView coded) override;
  std::vector<DecodedImage> takeDecoded() override { return std::exchange(done_, {}); }
  std::size_t pending() const override { return waiting_ + done_.size(); }

  // The page calls these with its answers.

  /// Returns room for the RGBA pixels of a finished image, valid until the next call of any of these.
  std::uint8_t* acceptPixels(std::uint64_t id, int width, int height);
  /// Notes that a face was an empty flag (`error` empty) or broken.
  void acceptFailure(std::uint64_t id, const std::string& error);

 private:
  std::size_t waiting_ = 0;
  std::vector<DecodedImage> done_;
};

}  // namespace client
