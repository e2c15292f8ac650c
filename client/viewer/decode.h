#pragma once
// Images are decoded off the render loop. Each platform brings its own decoder: libjpeg-turbo and libwebp on
// threads, or createImageBitmap in a browser.
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/image.h"

namespace client {

/// Turns coded faces into RGBA images (alpha = coverage), asynchronously.
class ImageDecoder {
 public:
  virtual ~ImageDecoder() = default;
  struct DecodedImage {
    std::uint64_t id = 0;
    base::Image rgba;   ///< empty when the face was an empty flag or broken
    std::string error;  ///< empty when all is well
  };
  /// Starts to decode a coded face (repository/faces/face_value.h), whose bytes are copied.
  virtual void submit(std::uint64_t id, base::ByteView coded) = 0;
  /// Returns the images finished since the last call; never waits.
  virtual std::vector<DecodedImage> takeDecoded() = 0;
  virtual std::size_t pending() const = 0;
};

}  // namespace client
