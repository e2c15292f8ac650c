#include "client/web/web_decoder.h"

#include <emscripten/emscripten.h>

// The page gets a copy, since the session may evict the face while a worker decodes it.
EM_JS(void, lumigridDecode, (std::uint32_t low, std::uint32_t high, const std::uint8_t* data, std::size_t size),
      { Module.decode(low >>> 0, high >>> 0, HEAPU8.slice(data, data + size)); });

namespace client {
namespace {

std::uint64_t idOf(std::uint32_t low, std::uint32_t high) {
  return std::uint64_t{high} << 32U | low;
}

}  // namespace

void WebDecoder::submit(std::uint64_t id, base::ByteView coded) {
  ++waiting_;
  lumigridDecode(static_cast<std::uint32_t>(id), static_cast<std::uint32_t>(id >> 32U), coded.data(), coded.size());
}

std::uint8_t* WebDecoder::acceptPixels(std::uint64_t id, int width, int height) {
  --waiting_;
  done_.push_back({id, base::Image(width, height, 4), {}});
  return done_.back().rgba.pixels.data();
}

void WebDecoder::acceptFailure(std::uint64_t id, const std::string& error) {
  --waiting_;
  done_.push_back({id, {}, error.empty() ? error : "an image from the server is broken: " + error});
}

}  // namespace client

extern "C" {

EMSCRIPTEN_KEEPALIVE std::uint8_t* decodedPixels(std::uint32_t low, std::uint32_t high, int width, int height) {
  auto* decoder = client::WebDecoder::instance();
  return decoder == nullptr ? nullptr : decoder->acceptPixels(client::idOf(low, high), width, height);
}

EMSCRIPTEN_KEEPALIVE void decodedNothing(std::uint32_t low, std::uint32_t high, const char* error) {
  auto* decoder = client::WebDecoder::instance();
  if (decoder != nullptr) decoder->acceptFailure(client::idOf(low, high), error);
}

}  // extern "C"
