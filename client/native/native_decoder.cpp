#include "client/native/native_decoder.h"

#include <utility>

#include "base/view_defaults.h"
#include "repository/faces/frame_image.h"

namespace client {

ImageDecoder::DecodedImage decodeFaceImage(std::uint64_t id, base::ByteView coded) {
  auto image = repository::decodeFrameImage(coded, base::ViewDefaults::kMaxFramePixels);
  if (!image) return {id, {}, "an image from the server is broken: " + image.error().message};
  return {id, std::move(*image), {}};
}

void NativeDecoder::submit(std::uint64_t id, base::ByteView coded) {
  {
    std::lock_guard lock(mutex_);
    ++pending_;
  }
  pool_.submit([this, id, copy = base::Bytes(coded.begin(), coded.end())] {
    DecodedImage decoded = decodeFaceImage(id, copy);
    std::lock_guard lock(mutex_);
    done_.push_back(std::move(decoded));
  });
}

std::vector<ImageDecoder::DecodedImage> NativeDecoder::takeDecoded() {
  std::lock_guard lock(mutex_);
  pending_ -= done_.size();
  return std::exchange(done_, {});
}

std::size_t NativeDecoder::pending() const {
  std::lock_guard lock(mutex_);
  return pending_;
}

}  // namespace client
