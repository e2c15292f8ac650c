#pragma once
// Sampling by use (Okamoto 2011, future work): of a grid only the points that a client would be sent. Most of a grid's
// points are nobody's choice: for views from anywhere the points between viewer and surface are worth most, and of two
// neighbours one does. What a point is worth is known before anything is rendered: the server's own choice
// (plan/point_choice.h), made for random views of the viewing box.
#include <cstdint>
#include <functional>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace server {

struct DemandOptions {
  std::uint32_t views = 1000;
  /// Points are left out as long as the choice for these views is worth at least this share of what it is worth with
  /// the whole grid (0..1).
  double worth = 0.97;
  unsigned threads = 0;  ///< 0: all cores; the result does not depend on it
};

/// A tree without open leaves whose points are those in demand; all others are left out. The same input gives the same
/// tree. `progress` is told a share of 0..1, which may stand still, and returns false to stop (kCancelled). Errors:
/// kInvalidInput where the model leaves no room for a view or no view sees it; those of reading patches.
base::Result<repository::SampleTree> treeInDemand(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                                  const repository::Grid& grid, const DemandOptions& options,
                                                  const std::function<bool(double done)>& progress = nullptr);

}  // namespace server
