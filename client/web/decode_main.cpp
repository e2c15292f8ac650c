// Decodes the part of a face that browsers have no function for: its container and its coverage mask. This is a
// WebAssembly module of its own for the page's workers; createImageBitmap decodes the JPEG itself
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

/// The face being decoded; a worker decodes one at a time.
struct Job {
  base::Bytes bytes;
  repository::FaceValue value;
  base::Image rgba;
  std::string error;
};
Job job;

}  // namespace

extern "C" {

/// Returns room for a coded face of `size` bytes, to be filled before parseValue().
EMSCRIPTEN_KEEPALIVE std::uint8_t* valueBuffer(std::size_t size) {
  job = {};
  job.bytes.resize(size);
  return job.bytes.data();
}

/// Returns −1 for a broken face (errorText() says why), 0 for an empty flag, 1 for an image.
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

/// Returns room for the decoded RGBA pixels; null when no image may have that size.
EMSCRIPTEN_KEEPALIVE std::uint8_t* pixelBuffer(int width, int height) {
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) return nullptr;
  job.rgba = base::Image(width, height, 4);
  return job.rgba.pixels.data();
}

/// Writes the coverage mask into the pixels' alpha; returns 0 when the mask is broken.
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
