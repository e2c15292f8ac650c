#pragma once
// Decoding off the render loop: each platform brings its own decoder (libjpeg-turbo on threads; createImageBitmap in a
// browser).
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/image.h"

namespace client {

/// Turns face values into RGBA images (alpha = coverage), asynchronously.
class ImageDecoder {
 public:
  virtual ~ImageDecoder() = default;
  struct DecodedImage {
    std::uint64_t id = 0;
    base::Image rgba;   ///< empty when the value was an empty flag or broken
    std::string error;  ///< empty when all is well
  };
  /// `value`: repository/face_value.h. Copies what it needs.
  virtual void submit(std::uint64_t id, base::ByteView value) = 0;
  /// Finished ones; never waits.
  virtual std::vector<DecodedImage> takeDecoded() = 0;
  virtual std::size_t pending() const = 0;
};

}  // namespace client
