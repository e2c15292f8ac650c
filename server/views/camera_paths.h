#pragma once
// Camera paths that are made for a scene: those of `lumigrid tour --path` and of comparisons.
#include <cstdint>
#include <string>
#include <vector>

#include "base/camera_path.h"
#include "base/error.h"
#include "base/json/scene_file.h"
#include "server/views/indoors.h"

namespace server {

struct PathOptions {
  int width = 640, height = 360;
  double seconds = 12.0;
  std::uint32_t seed = 1;
};

/// "orbit", "approach", "walk", "inspection", "jitter", "teleports", and each with "-fast" at its end: the same at six
/// times the speed (docs/formats/comparison.md, "Methods, paths and links").
const std::vector<std::string>& pathNames();
/// `indoors`: rooms that the path goes through; null: it goes around the scene. kInvalidInput for a name that there is
/// not.
base::Result<base::CameraPath> makePath(const std::string& name, const base::Scene& scene, const PathOptions& options,
                                        const Indoors* indoors = nullptr);

/// `frames` still views, of no size, of an interior: evenly along the walk through its rooms, looking ahead.
std::vector<base::ViewCamera> roomsTour(const base::Scene& scene, const Indoors& indoors, int frames);

}  // namespace server
