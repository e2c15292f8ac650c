#pragma once
// Measures how far a picture is from the truth. compare/ computes its figures by OpenCV, with the same constants.
#include <cstdint>

#include "base/image.h"

namespace base {

/// A pixel is model, and foreground, when at least half of it is covered: from this alpha on.
inline constexpr std::uint8_t kCoverageThreshold = 128;
/// The colour beneath pixels that are not wholly covered, and in holes: 18 % reflectance in sRGB, photography's grey
/// card.
inline constexpr float kMidGrey = 118.0F;
/// The PSNR of equal pictures, which would be infinite, and the largest that is reported.
inline constexpr double kEqualDb = 99.0;

/// One channel of an RGBA pixel, alpha = coverage, not premultiplied, laid over mid-grey.
inline float overGrey(const std::uint8_t* rgba, int channel) {
  const float alpha = static_cast<float>(rgba[3]) / 255.0F;
  return alpha * static_cast<float>(rgba[channel]) + (1.0F - alpha) * kMidGrey;
}

/// Sums of differences over R, G and B of pixels, 8-bit levels.
struct PictureError {
  double squared = 0.0;
  double absolute = 0.0;
  std::uint64_t samples = 0;  ///< three per pixel

  void add(double difference);
  void add(const PictureError& other);
  /// kEqualDb when all samples are equal, or none was compared.
  double psnr() const;
};

/// The error of a picture as it is seen: both are laid over mid-grey and compared over the foreground, the pixels that
/// the truth or the picture covers at least half, so that missing and excess parts both count. RGBA of the same size.
PictureError pictureError(const Image& truth, const Image& picture);

/// The error that compression adds to a face: over the pixels that are model in `rgba`, its colours against those of
/// `rgb`, without a background, since the mask is stored without loss and filler is never seen. The sums are whole
/// numbers, hence exact in any order. Images of the same size.
PictureError modelError(const Image& rgba, const Image& rgb);

}  // namespace base
