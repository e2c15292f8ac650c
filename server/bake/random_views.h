#pragma once
// Random views of a scene: the held-out views of `lumigrid tour --random`, and the views for which sampling points are
// selected.
#include <cstdint>
#include <vector>

#include "base/camera.h"
#include "base/json/scene_file.h"
#include "server/bake/enclosed.h"
#include "server/bake/viewer_places.h"

namespace server {

struct RandomViews {
  std::size_t count = 16;
  std::uint32_t seed = 1;
  double margin = 0.5;  ///< viewing box beyond the model on every side, in longest sides of the model
  int width = 1280, height = 720;
};

/// Eyes lie anywhere in the viewing box but within or behind the model; each looks at some place in the middle half of
/// the model's box. The same seed gives the same views on every machine. Fewer views where the model leaves no room.
std::vector<base::ViewCamera> randomViews(const base::Scene& scene, const Enclosure& enclosure,
                                          const RandomViews& options);

/// The same from where viewers were and in the directions in which they looked; options.margin does not matter.
std::vector<base::ViewCamera> randomViewerViews(const base::Scene& scene, const Enclosure& enclosure,
                                                const ViewerPlaces& places, const RandomViews& options);

}  // namespace server
