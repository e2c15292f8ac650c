#pragma once
// How far a picture is from the truth. All figures are of foreground pixels only, so that background flatters nobody.
#include <cstdint>

#include "base/error.h"
#include "base/image.h"

namespace compare {

/// A pixel is foreground when the truth or the picture covers at least a sixteenth of it, so that thin parts count
/// whether the picture has them or not. Pixels that are not wholly covered are laid over mid-grey, which also shows in
/// holes. Shares and silhouettes are of the pixels of which at least half is covered.
struct Accuracy {
  double psnr_db = 0.0;  ///< over the foreground's RGB samples; 99 when equal
  double ssim = 0.0;     ///< mean over the foreground; luma, 11 × 11 Gaussian window of σ 1.5 (Wang et al. 2004)
  double missing_share = 0.0;      ///< pixels of the truth that the picture leaves uncovered, as a share of the truth's
  double excess_share = 0.0;       ///< pixels that the picture covers and the truth does not, as a share of the truth's
  double mean_abs = 0.0;           ///< mean absolute difference, 8-bit levels
  double silhouette_px = 0.0;      ///< mean distance from one picture's silhouette to the other's, both ways, pixels
  double silhouette_p95_px = 0.0;  ///< 95th percentile of the distances of all pixels of both silhouettes
  std::uint64_t foreground = 0;    ///< pixels
};

/// RGBA against RGBA of the same size, alpha = coverage, colour not premultiplied. An error names the sizes when they
/// differ, or says that there is no foreground.
base::Result<Accuracy> measureAccuracy(const base::Image& truth, const base::Image& picture);

/// One display's picture and the truth of its view, RGBA of the same size.
struct JudgedPicture {
  base::Image truth, picture;
};
/// How much more a display changes from one frame to the next than the truth does: max(0, |p₁ − p₀| − |t₁ − t₀|) in
/// 8-bit levels, over the pixels that are foreground in any of the four pictures. A picture that lacks detail does not
/// flicker; sparks at seams, popping and judder do. 0 where nothing is foreground.
struct Flicker {
  static constexpr double kVisible = 8.0;  ///< levels; a choice: smaller changes are hardly seen
  double mean = 0.0;                       ///< over RGB, levels
  double share = 0.0;                      ///< pixels of which a channel changes by more than kVisible, 0..1
};
Flicker measureFlicker(const JudgedPicture& before, const JudgedPicture& after);

/// Lays a picture with coverage over mid-grey, as measureAccuracy() does. RGB.
base::Image overMidGrey(const base::Image& rgba);

/// |truth − picture| × 4 on black, to see where a method fails.
base::Image differencePicture(const base::Image& truth, const base::Image& picture);

}  // namespace compare
