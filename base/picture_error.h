#pragma once
// How far a picture is from the truth: the one measure by which builds choose and comparisons judge.
#include <cstdint>

#include "base/image.h"

namespace base {

/// A pixel is model, and foreground, when at least half of it is covered: alpha from here on.
inline constexpr std::uint8_t kCoverageThreshold = 128;
/// What lies beneath a pixel that is not wholly covered; also what a hole shows.
inline constexpr float kMidGrey = 118.0F;
/// Of equal pictures, and the most that is said.
inline constexpr double kEqualDb = 99.0;

/// One channel of an RGBA pixel, alpha = coverage, not premultiplied, laid over mid-grey.
inline float overGrey(const std::uint8_t* rgba, int channel) {
  const float alpha = static_cast<float>(rgba[3]) / 255.0F;
  return alpha * static_cast<float>(rgba[channel]) + (1.0F - alpha) * kMidGrey;
}

/// Sums over R, G and B of pixels, 8-bit levels.
struct PictureError {
  double squared = 0.0;
  double absolute = 0.0;
  std::uint64_t samples = 0;  ///< three a pixel

  void add(double difference);
  void add(const PictureError& other);
  /// kEqualDb where nothing is off, or nothing was compared.
  double psnr() const;
};

/// Of pictures as they are seen: over foreground pixels, those that the truth or the picture covers at least half (a
/// missing part and a part too much both count), laid over mid-grey. RGBA of the same size.
PictureError pictureError(const Image& truth, const Image& picture);

/// Of what compression does to a face: over the pixels that `rgba` calls model, its colours against `rgb`'s, nothing
/// beneath. Another measure than pictureError, since the mask is kept without loss and filler is never seen. Sums of
/// whole numbers, exact whatever their order. The same size.
PictureError modelError(const Image& rgba, const Image& rgb);

}  // namespace base
