// The part of decoding an image that a browser has no help for, as a WebAssembly module of its own for the page's
// workers: what a face value holds, and its coverage mask. The JPEG itself goes to createImageBitmap
// (client/web/site/decode_worker.js).
#include <emscripten/emscripten.h>

#include <cstdint>
#include <string>

#include "base/bytes.h"
#include "base/image.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"

namespace {

constexpr int kMaxSide = 16384;

/// One worker decodes one image at a time.
struct Job {
  base::Bytes bytes;
  repository::FaceValue value;
  base::Image rgba;
  std::string error;
};
Job job;

}  // namespace

extern "C" {

/// Room for a face value of `size` bytes, to be filled before parseValue().
EMSCRIPTEN_KEEPALIVE std::uint8_t* valueBuffer(std::size_t size) {
  job = {};
  job.bytes.resize(size);
  return job.bytes.data();
}

/// −1: broken (errorText() says how), 0: an empty flag, 1: an image.
EMSCRIPTEN_KEEPALIVE int parseValue() {
  auto value = repository::decodeFaceValue(job.bytes);
  if (!value) {
    job.error = value.error().message;
    return -1;
  }
  job.value = *value;
  return value->empty ? 0 : 1;
}

EMSCRIPTEN_KEEPALIVE const std::uint8_t* jpegData() {
  return job.value.jpeg.data();
}
EMSCRIPTEN_KEEPALIVE std::size_t jpegSize() {
  return job.value.jpeg.size();
}

/// Room for the decoded pixels, RGBA; null when no image has that size.
EMSCRIPTEN_KEEPALIVE std::uint8_t* pixelBuffer(int width, int height) {
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) return nullptr;
  job.rgba = base::Image(width, height, 4);
  return job.rgba.pixels.data();
}

/// Writes the coverage mask into the pixels' alpha; 0 when the mask is broken.
EMSCRIPTEN_KEEPALIVE int applyCoverage() {
  if (job.value.coverage.empty()) return 1;
  auto mask = repository::decodeCoverage(job.value.coverage, job.rgba.width, job.rgba.height);
  if (!mask) {
    job.error = mask.error().message;
    return 0;
  }
  for (std::size_t i = 0; i < mask->pixels.size(); ++i) job.rgba.pixels[4 * i + 3] = mask->pixels[i];
  return 1;
}

EMSCRIPTEN_KEEPALIVE const char* errorText() {
  return job.error.c_str();
}

}  // extern "C"
