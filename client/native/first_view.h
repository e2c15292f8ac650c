#pragma once
// The view with which a scene is seen first, for programs without a window.
#include <string>

#include "base/camera.h"
#include "base/error.h"
#include "client/app/view_state.h"
#include "protocol/message.h"

namespace client {

struct FirstView {
  base::ViewCamera camera;
  OwnLight light;
  bool colors_by_resolution = false;
};

/// The view that a window of this size (pixels, at least 1) begins with: that of a permalink, or where `link` is empty
/// the scene's own, or else the whole of the model. Errors: those of parsePermalink(link).
base::Result<FirstView> firstViewOf(const protocol::Welcome& scene, const std::string& link, int width, int height);

}  // namespace client
