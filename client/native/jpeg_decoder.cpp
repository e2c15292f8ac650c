#include "client/native/jpeg_decoder.h"

#include <limits>
#include <mutex>
#include <utility>

#include "base/parallel.h"
#include "repository/faces/face_image.h"

namespace client {

ImageDecoder::DecodedImage decodeFaceImage(std::uint64_t id, base::ByteView coded) {
  auto image = repository::decodeFaceImage(coded, 0);  // 0: any size, since exact frames have that of the view
  if (!image) return {id, {}, "an image from the server is broken: " + image.error().message};
  return {id, std::move(*image), {}};
}

struct JpegDecoder::Impl {
  explicit Impl(unsigned threads) : pool(threads, std::numeric_limits<std::size_t>::max()) {}
  mutable std::mutex mutex;
  std::vector<DecodedImage> done;
  std::size_t pending = 0;  // submitted and not taken yet
  base::ThreadPool pool;    // last member, so that its threads end before the members they write to
};

JpegDecoder::JpegDecoder(unsigned threads) : impl_(std::make_unique<Impl>(threads)) {}
JpegDecoder::~JpegDecoder() = default;

void JpegDecoder::submit(std::uint64_t id, base::ByteView coded) {
  Impl* s = impl_.get();
  {
    std::lock_guard lock(s->mutex);
    ++s->pending;
  }
  s->pool.submit([s, id, copy = base::Bytes(coded.begin(), coded.end())] {
    DecodedImage decoded = decodeFaceImage(id, copy);
    std::lock_guard lock(s->mutex);
    s->done.push_back(std::move(decoded));
  });
}

std::vector<ImageDecoder::DecodedImage> JpegDecoder::takeDecoded() {
  std::lock_guard lock(impl_->mutex);
  impl_->pending -= impl_->done.size();
  return std::exchange(impl_->done, {});
}

std::size_t JpegDecoder::pending() const {
  std::lock_guard lock(impl_->mutex);
  return impl_->pending;
}

}  // namespace client
