#pragma once
// Views from random places, to look at a scene as somebody might who goes anywhere: held-out views (`lumigrid tour
// --random`), and those for which sampling points are chosen.
#include <cstdint>
#include <vector>

#include "base/camera.h"
#include "base/json/scene_file.h"
#include "server/bake/enclosed.h"

namespace server {

struct RandomViews {
  std::size_t count = 16;
  std::uint32_t seed = 1;
  double margin = 0.5;  ///< of the viewing box: beyond the model on every side, in its longest sides
  int width = 1280, height = 720;
};

/// Eyes anywhere in the viewing box but within or behind the model, each looking at some place in the middle half of
/// the model's box. The same everywhere for the same seed. Fewer where the model leaves no room.
std::vector<base::ViewCamera> randomViews(const base::Scene& scene, const Enclosure& enclosure,
                                          const RandomViews& options);

}  // namespace server
