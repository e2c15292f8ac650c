#pragma once
// Translates settings to the quality of streamed methods.
#include "client/app/settings.h"
#include "client/source/streamed_view.h"

namespace client {

/// Returns StreamedQuality::frame_seconds for a frame rate; 0 stays 0.
inline double secondsPerFrame(double rate) {
  return rate > 0.0 ? 1.0 / rate : 0.0;
}

/// Returns the quality that the settings ask for.
inline StreamedQuality qualityOf(const Settings& settings) {
  return {static_cast<lod::draw::SplatKernel>(static_cast<int>(settings.splat)), static_cast<float>(settings.cutoff),
          secondsPerFrame(settings.frame_rate), static_cast<float>(settings.tolerance),
          static_cast<float>(settings.error_px)};
}
/// Applies only the settings that differ between `before` and `after`; the rest, which a command line may have set,
/// stays.
inline void applyChanges(const Settings& before, const Settings& after, StreamedQuality& quality) {
  const StreamedQuality wanted = qualityOf(after);
  if (after.splat != before.splat) quality.kernel = wanted.kernel;
  if (after.cutoff != before.cutoff) quality.cutoff_px = wanted.cutoff_px;
  if (after.tolerance != before.tolerance) quality.tolerance = wanted.tolerance;
  if (after.error_px != before.error_px) quality.error_px = wanted.error_px;
  if (after.frame_rate != before.frame_rate) quality.frame_seconds = wanted.frame_seconds;
}

}  // namespace client
