#pragma once
// Camera paths in time: what somebody looks at, second by second.
#include <vector>

#include "base/camera.h"

namespace base {

struct CameraPath {
  std::vector<ViewCamera> frames;
  double frames_per_second = 0.0;  ///< 0: the frames have no times
  bool jumps = false;              ///< the view stays until the next frame; otherwise it moves there evenly

  /// How long the path lasts. It has times.
  double seconds() const { return static_cast<double>(frames.size()) / frames_per_second; }
  /// The view at `seconds` after the begin; after the end the last one.
  ViewCamera at(double seconds) const;
};

/// A view that somebody had at an instant, in seconds.
struct SeenView {
  double seconds = 0.0;
  ViewCamera view;
};
/// Makes a path with even times of views at uneven ones, which ascend. It begins with the first; a view counts from its
/// instant on.
CameraPath pathOf(const std::vector<SeenView>& views, double frames_per_second);

}  // namespace base
