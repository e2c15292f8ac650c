// Decodes the part of a face or frame that browsers have no function for: its container, its coverage mask, and colours
// where there is no model. This is a WebAssembly module of its own for the page's workers; createImageBitmap decodes
// the JPEG or WebP itself (client/web/site/decode_worker.js).
#include <emscripten/emscripten.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>

#include "base/bytes.h"
#include "base/image.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/faces/filler.h"

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

int fail(std::string error) {
  job.error = std::move(error);
  return 0;
}

/// A canvas drops the colours of pixels without coverage, which filters would mix into those of the model's edge.
void fillColors() {
  base::Image alpha(job.rgba.width, job.rgba.height, 1);
  for (std::size_t i = 0; i < alpha.pixels.size(); ++i) alpha.pixels[i] = job.rgba.pixels[4 * i + 3];
  const base::Image filled = repository::fillBackground(job.rgba, alpha);
  for (std::size_t i = 0; i < alpha.pixels.size(); ++i)
    if (alpha.pixels[i] == 0) std::copy_n(&filled.pixels[3 * i], 3, &job.rgba.pixels[4 * i]);
}

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

EMSCRIPTEN_KEEPALIVE int pictureIsWebp() {
  return repository::isWebp(job.value.picture) ? 1 : 0;
}
EMSCRIPTEN_KEEPALIVE const std::uint8_t* pictureData() {
  return job.value.picture.data();
}
EMSCRIPTEN_KEEPALIVE std::size_t pictureSize() {
  return job.value.picture.size();
}

/// Returns room for the decoded RGBA pixels; null when no image may have that size.
EMSCRIPTEN_KEEPALIVE std::uint8_t* pixelBuffer(int width, int height) {
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) return nullptr;
  job.rgba = base::Image(width, height, 4);
  return job.rgba.pixels.data();
}

/// Writes the coverage mask into the pixels' alpha; returns 0 when the mask is broken. WebP holds alpha itself.
EMSCRIPTEN_KEEPALIVE int applyCoverage() {
  const bool is_webp = repository::isWebp(job.value.picture);
  if (job.value.coverage.empty()) {
    if (is_webp) fillColors();
    return 1;
  }
  if (is_webp) return fail("WebP: a mask comes with it, though it holds alpha itself");
  auto mask = repository::decodeCoverage(job.value.coverage, job.rgba.width, job.rgba.height);
  if (!mask) return fail(mask.error().message);
  for (std::size_t i = 0; i < mask->pixels.size(); ++i) job.rgba.pixels[4 * i + 3] = mask->pixels[i];
  return 1;
}

EMSCRIPTEN_KEEPALIVE const char* errorText() {
  return job.error.c_str();
}

}  // extern "C"
