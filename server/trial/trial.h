#pragma once
// Tries what a scene is best shown by, before its images are made (`build --methods auto`): a server's session and a
// viewer, joined without a link, show held-out views by patches alone and by images over coarser patches.
#include <cstddef>
#include <cstdint>
#include <functional>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "server/bake/bake.h"

namespace server {

/// The accuracy and the cost of one method over all views.
struct TrialFigures {
  double mean_psnr_db = 0.0;   ///< mean over the views, on foreground pixels, against the full model
  double worst_psnr_db = 0.0;  ///< of the worst view
  std::uint64_t bytes = 0;     ///< sent for all views, one after the other, to one client; no prefetch
  friend bool operator==(const TrialFigures&, const TrialFigures&) = default;
};

struct Trial {
  /// Images have to show so many decibels more than patches alone: less than what two pictures that look alike differ
  /// by, but what a comparison can tell (docs/results.md).
  static constexpr double kMinGainDb = 0.3;

  std::size_t views = 0;
  TrialFigures patches;  ///< at base::ViewDefaults::kAloneTolerance
  TrialFigures images;   ///< over patches at base::ViewDefaults::kPatchTolerance

  double gainDb() const { return images.mean_psnr_db - patches.mean_psnr_db; }
  bool imagesPay() const { return gainDb() >= kMinGainDb; }
  friend bool operator==(const Trial&, const Trial&) = default;
};

/// Shows views from all around the scene and from close by: two instants of each of the camera paths that comparisons
/// have (camera_paths.h), with another seed. Faces are drawn as a bake with these options would, all points of its grid
/// being sampled. `progress` gets 0 to 1 and returns false to stop (kCancelled). Errors also: kInvalidInput when no
/// view shows the model; kNoSpace as bake(); those of GL and of reading patches.
base::Result<Trial> tryMethods(const base::Scene& scene, const lod::patch::PatchFile& patches,
                               const BakeOptions& options, const std::function<bool(double done)>& progress);

}  // namespace server
