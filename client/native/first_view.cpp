#include "client/native/first_view.h"

#include <optional>
#include <utility>

#include "client/app/orbit_control.h"
#include "client/app/permalink.h"

namespace client {

base::Result<FirstView> firstViewOf(const protocol::Welcome& scene, const std::string& link, int width, int height) {
  OrbitControl control;
  control.setViewport(width, height);
  control.frameScene(scene);
  std::optional<ViewState> wanted;
  if (!link.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(wanted, parsePermalink(link));
  } else if (auto own = parsePermalink(scene.start_view)) {
    // A text that a later program wrote leaves the whole model in view.
    wanted = std::move(*own);
  }
  FirstView first;
  Section section;
  if (wanted) {
    control.setFov(wanted->fov_y);
    control.setOrthographic(wanted->orthographic);
    if (wanted->pivot_distance > 0.0)
      control.setViewpoint({wanted->position, wanted->direction, wanted->pivot_distance});
    section = wanted->section;
    first.light = wanted->light;
    first.colors_by_resolution = wanted->colors_by_resolution;
  }
  first.camera = control.camera();
  first.camera.ortho_height = control.orthoHeight();
  first.camera.section = section.plane();
  return first;
}

}  // namespace client
