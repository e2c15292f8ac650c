#pragma once
// The value under a FaceKey is an empty flag, or a picture with its coverage mask, and always has a checksum
// (docs/formats/repository.md, "Value").
#include <optional>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"

namespace repository {

/// The bytes before the picture and the mask, in a value that is no empty flag.
inline constexpr std::size_t kImageHeaderBytes = 16;

/// The views point into the value's bytes and are valid as long as these are.
struct FaceValue {
  bool empty = true;  ///< the face sees nothing: no image, no mask
  /// JPEG or WebP; background pixels carry filler that the mask or alpha hides.
  base::ByteView picture;
  base::ByteView coverage;  ///< from encodeCoverage(); size 0 when every pixel is model, or WebP holds alpha
  /// For a tile: bit c says that child c of it (tile.h) is stored too. Where it is not, that quarter of the image has
  /// all there is to see.
  std::uint8_t children = 0;
};

enum class ImageCodec { kJpeg, kWebp };
const char* nameOf(ImageCodec codec);  ///< "jpeg", "webp"
/// The inverse of nameOf(); nothing for any other name.
std::optional<ImageCodec> imageCodecOf(std::string_view name);

/// Tells by its first twelve bytes whether a picture is WebP; else it is JPEG, or broken.
bool isWebp(base::ByteView picture);

base::Bytes encodeFaceValue(const FaceValue& value);
/// Checks magic, lengths and CRC.
base::Result<FaceValue> decodeFaceValue(base::ByteView bytes);

}  // namespace repository
