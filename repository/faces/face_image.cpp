#include "repository/faces/face_image.h"

#include <algorithm>
#include <string>
#include <utility>

#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/faces/webp.h"

namespace repository {
namespace {

base::Result<void> checkSize(const base::Image& picture, int side) {
  if (side == 0 || (picture.width == side && picture.height == side)) return {};
  return base::Error{base::ErrorCode::kInvalidInput, "a picture of " + std::to_string(picture.width) + " x " +
                                                         std::to_string(picture.height) + " pixels, not " +
                                                         std::to_string(side)};
}

base::Result<FacePixels> decodeWebpPixels(const FaceValue& face, int side) {
  const std::int64_t most = side == 0 ? std::int64_t{kMaxWebpSide} * kMaxWebpSide : std::int64_t{side} * side;
  LUMIGRID_ASSIGN_OR_RETURN(const auto rgba, decodeWebpImage(face, most));
  LUMIGRID_TRY(checkSize(rgba, side));
  FacePixels pixels{base::Image(rgba.width, rgba.height, 3), base::Image(rgba.width, rgba.height, 1)};
  for (std::size_t i = 0; i < pixels.mask.pixels.size(); ++i) {
    std::copy_n(&rgba.pixels[4 * i], 3, &pixels.rgb.pixels[3 * i]);
    pixels.mask.pixels[i] = rgba.pixels[4 * i + 3];
  }
  return pixels;
}

}  // namespace

base::Result<base::Image> decodeWebpImage(const FaceValue& face, std::int64_t max_pixels) {
  if (!face.coverage.empty())
    return base::Error{base::ErrorCode::kInvalidInput, "WebP: a mask comes with it, though it holds alpha itself"};
  return decodeWebp(face.picture, max_pixels);
}

base::Result<FacePixels> decodeFacePixels(base::ByteView value, int side) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto face, decodeFaceValue(value));
  if (face.empty) return FacePixels();
  if (isWebp(face.picture)) return decodeWebpPixels(face, side);
  LUMIGRID_ASSIGN_OR_RETURN(auto rgb,
                            side == 0 ? base::decodeJpeg(face.picture) : base::decodeJpeg(face.picture, side));
  LUMIGRID_TRY(checkSize(rgb, side));
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
