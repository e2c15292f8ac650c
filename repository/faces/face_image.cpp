#include "repository/faces/face_image.h"

#include <algorithm>
#include <string>
#include <utility>

#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/faces/jpeg.h"

namespace repository {

base::Result<FacePixels> decodeFacePixels(base::ByteView value, int side) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto face, decodeFaceValue(value));
  if (face.empty) return FacePixels();
  if (isWebp(face.picture))
    return base::Error{base::ErrorCode::kInvalidInput, "a picture in WebP, which exact frames alone may be"};
  LUMIGRID_ASSIGN_OR_RETURN(auto rgb, side == 0 ? decodeJpeg(face.picture) : decodeJpeg(face.picture, side));
  if (side != 0 && (rgb.width != side || rgb.height != side))
    return base::Error{base::ErrorCode::kInvalidInput, "a picture of " + std::to_string(rgb.width) + " x " +
                                                           std::to_string(rgb.height) + " pixels, not " +
                                                           std::to_string(side)};
  LUMIGRID_ASSIGN_OR_RETURN(auto mask, decodeCoverage(face.coverage, rgb.width, rgb.height));
  return FacePixels{std::move(rgb), std::move(mask)};
}

base::Result<base::Image> decodeFaceImage(base::ByteView value, int side) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto pixels, decodeFacePixels(value, side));
  if (pixels.rgb.empty()) return base::Image();
  base::Image rgba(pixels.rgb.width, pixels.rgb.height, 4);
  for (std::size_t i = 0; i < pixels.mask.pixels.size(); ++i) {
    std::copy_n(&pixels.rgb.pixels[3 * i], 3, &rgba.pixels[4 * i]);
    rgba.pixels[4 * i + 3] = pixels.mask.pixels[i];
  }
  return rgba;
}

}  // namespace repository
