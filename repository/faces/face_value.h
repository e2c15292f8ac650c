#pragma once
// The value under a FaceKey: an empty flag, or a JPEG with its coverage mask; always with a checksum.
// docs/formats/repository.md
#include "base/bytes.h"
#include "base/error.h"

namespace repository {

/// Of a value that is no empty flag, before its JPEG and mask.
inline constexpr std::size_t kImageHeaderBytes = 16;

/// Views into the value's bytes; valid as long as they are.
struct FaceValue {
  bool empty = true;        ///< the face sees nothing: no image, no mask
  base::ByteView jpeg;      ///< face_size × face_size; background pixels carry filler that the mask hides
  base::ByteView coverage;  ///< encodeCoverage(); of size 0 when every pixel is model
};

base::Bytes encodeFaceValue(const FaceValue& value);
/// Checks magic, lengths and CRC.
base::Result<FaceValue> decodeFaceValue(base::ByteView bytes);

}  // namespace repository
