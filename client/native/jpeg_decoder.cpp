#include "client/native/jpeg_decoder.h"

#include <algorithm>
#include <limits>
#include <mutex>
#include <utility>

#include "base/parallel.h"
#include "repository/coverage.h"
#include "repository/face_value.h"
#include "repository/jpeg.h"

namespace client {
namespace {

base::Result<base::Image> decodeValue(base::ByteView bytes) {
  auto value = repository::decodeFaceValue(bytes);
  if (!value) return value.error();
  if (value->empty) return base::Image();
  auto rgb = repository::decodeJpeg(value->jpeg);
  if (!rgb) return rgb.error();
  base::Image mask;
  if (!value->coverage.empty()) {
    auto decoded = repository::decodeCoverage(value->coverage, rgb->width, rgb->height);
    if (!decoded) return decoded.error();
    mask = std::move(*decoded);
  }

  base::Image rgba(rgb->width, rgb->height, 4);
  const std::size_t count = rgba.pixels.size() / 4;
  for (std::size_t i = 0; i < count; ++i) {
    std::copy_n(rgb->pixels.data() + 3 * i, 3, rgba.pixels.data() + 4 * i);
    rgba.pixels[4 * i + 3] = mask.empty() ? 255 : mask.pixels[i];
  }
  return rgba;
}

}  // namespace

ImageDecoder::Decoded decodeFaceImage(std::uint64_t id, base::ByteView value) {
  auto image = decodeValue(value);
  if (!image) return {id, {}, "an image from the server is broken: " + image.error().message};
  return {id, std::move(*image), {}};
}

struct JpegDecoder::State {
  explicit State(unsigned threads) : pool(threads, std::numeric_limits<std::size_t>::max()) {}
  mutable std::mutex mutex;
  std::vector<Decoded> done;
  std::size_t pending = 0;  // submitted and not taken
  base::ThreadPool pool;    // last: its threads end before what they write to
};

JpegDecoder::JpegDecoder(unsigned threads) : state_(std::make_unique<State>(threads)) {}
JpegDecoder::~JpegDecoder() = default;

void JpegDecoder::submit(std::uint64_t id, base::ByteView value) {
  State* s = state_.get();
  {
    std::lock_guard lock(s->mutex);
    ++s->pending;
  }
  s->pool.submit([s, id, copy = base::Bytes(value.begin(), value.end())] {
    Decoded decoded = decodeFaceImage(id, copy);
    std::lock_guard lock(s->mutex);
    s->done.push_back(std::move(decoded));
  });
}

std::vector<ImageDecoder::Decoded> JpegDecoder::take() {
  std::lock_guard lock(state_->mutex);
  state_->pending -= state_->done.size();
  return std::exchange(state_->done, {});
}

std::size_t JpegDecoder::pending() const {
  std::lock_guard lock(state_->mutex);
  return state_->pending;
}

}  // namespace client
