#pragma once
// Measures how far pictures are from others: faces from what was compressed, and what a client shows from the truth.
// compare/ measures more, by OpenCV.
#include <cstdint>

#include "base/image.h"

namespace base {

/// A pixel is model when at least half of it is covered: from this alpha on. Half of the samples are 127 on some GPUs,
/// which round 127.5 down, and 128 on others.
inline constexpr std::uint8_t kCoverageThreshold = 127;
/// A pixel counts where pictures are compared when either covers a sixteenth of it: thin parts cover less than half of
/// the pixels that they cross, and a picture that lacks them must not be the better for it.
inline constexpr std::uint8_t kForegroundThreshold = 16;
/// The PSNR of equal pictures, which would be infinite, and the largest that is reported.
inline constexpr double kEqualDb = 99.0;

/// The colour beneath pixels that are not wholly covered, and in holes, where pictures are compared: 18 % reflectance
/// in sRGB, photography's grey card.
inline constexpr double kMidGrey = 118.0;

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

/// The error that compression adds to a face: over the pixels that are model in `rgba`, its colours against those of
/// `rgb`, without a background, since the mask is stored without loss and filler is never seen. The sums are whole
/// numbers, hence exact in any order. Images of the same size.
PictureError modelError(const Image& rgba, const Image& rgb);

/// The error of a picture against the truth: over the pixels that either covers (kForegroundThreshold), both laid over
/// mid-grey, which also shows in holes; as compare::measureAccuracy() does. RGBA of the same size, colour not
/// premultiplied.
PictureError foregroundError(const Image& truth, const Image& picture);

}  // namespace base
