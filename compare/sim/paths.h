#pragma once
// Camera paths in time: what somebody looks at, second by second.
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/json/scene_file.h"

namespace compare {

struct TimedPath {
  std::string name;
  double rate = 1.0;                     ///< frames a second; the view moves evenly from one to the next
  bool steps = false;                    ///< the view jumps from one to the next instead
  std::vector<base::ViewCamera> frames;  ///< one or more

  double seconds() const { return static_cast<double>(frames.size()) / rate; }
  /// The view at `seconds` after the begin; after the end the last one.
  base::ViewCamera at(double seconds) const;
};

struct PathOptions {
  int width = 640, height = 360;
  double seconds = 12.0;
  std::uint32_t seed = 1;
};

/// "orbit", "approach", "walk", "inspection", "teleports", "jitter", and each with "-fast" at its end: the same at six
/// times the speed (docs/formats/comparison.md, "Paths").
const std::vector<std::string>& pathNames();
/// kInvalidInput for a name that there is not.
base::Result<TimedPath> makePath(const std::string& name, const base::Scene& scene, const PathOptions& options);
/// A path of docs/formats/camera.md. Its frames are views at which somebody stops for `stop_seconds`.
base::Result<TimedPath> readPath(const std::string& file, double stop_seconds);

}  // namespace compare
