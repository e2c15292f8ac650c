#pragma once
// The settings of a person, as the quality that a view of splats is asked for.
#include "client/app/settings.h"
#include "client/source/splat_view.h"

namespace client {

/// SplatQuality::frame_seconds of a rate that people ask for; 0 stays 0.
inline double secondsPerFrame(double rate) {
  return rate > 0.0 ? 1.0 / rate : 0.0;
}

/// What settings say of it.
inline SplatQuality qualityOf(const Settings& settings) {
  return {static_cast<lod::draw::SplatKernel>(static_cast<int>(settings.splat)), static_cast<float>(settings.cutoff),
          secondsPerFrame(settings.frame_rate)};
}
/// The same where `after` differs from `before`; the rest stays as it is, which a command line may have set.
inline void takeChanges(const Settings& before, const Settings& after, SplatQuality& quality) {
  const SplatQuality wanted = qualityOf(after);
  if (after.splat != before.splat) quality.kernel = wanted.kernel;
  if (after.cutoff != before.cutoff) quality.cutoff_px = wanted.cutoff_px;
  if (after.frame_rate != before.frame_rate) quality.frame_seconds = wanted.frame_seconds;
}

}  // namespace client
