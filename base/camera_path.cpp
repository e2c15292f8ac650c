#include "base/camera_path.h"

#include <algorithm>
#include <cmath>

namespace base {

ViewCamera CameraPath::at(double seconds) const {
  const double place = std::clamp(seconds * frames_per_second, 0.0, static_cast<double>(frames.size() - 1));
  const auto before = static_cast<std::size_t>(place);
  const double share = place - static_cast<double>(before);
  if (jumps || share <= 0.0 || before + 1 >= frames.size() || frames[before] == frames[before + 1])
    return frames[before];
  const ViewCamera &a = frames[before], &b = frames[before + 1];
  ViewCamera view = a;
  view.position = glm::mix(a.position, b.position, share);
  const glm::dvec3 direction = glm::mix(a.direction, b.direction, share);
  if (glm::length(direction) > 1e-6) view.direction = glm::normalize(direction);
  view.up = glm::mix(a.up, b.up, share);
  view.fov_y = glm::mix(a.fov_y, b.fov_y, share);
  if (a.orthographic() == b.orthographic()) view.ortho_height = glm::mix(a.ortho_height, b.ortho_height, share);
  return view;
}

CameraPath pathOf(const std::vector<SeenView>& views, double frames_per_second) {
  CameraPath path;
  path.frames_per_second = frames_per_second;
  if (views.empty()) return path;
  const double length = views.back().seconds - views.front().seconds;
  const auto count = static_cast<std::size_t>(std::floor(length * frames_per_second + 1e-9)) + 1;
  std::size_t seen = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double now = views.front().seconds + static_cast<double>(i) / frames_per_second + 1e-9;
    while (seen + 1 < views.size() && views[seen + 1].seconds <= now) ++seen;
    path.frames.push_back(views[seen].view);
  }
  return path;
}

}  // namespace base
