#pragma once
// The screen of a client in virtual time: draws its viewer and reads the picture.
#include <utility>

#include "base/gl/gl.h"
#include "client/viewer/viewer.h"

namespace compare {

class ViewerScreen {
 public:
  /// Returns what `viewer` shows of `camera` at `now`, seconds. RGBA, alpha is coverage.
  base::Result<base::Image> show(client::Viewer& viewer, const base::ViewCamera& camera, double now) {
    if (target_.width() != camera.width || target_.height() != camera.height) {
      LUMIGRID_ASSIGN_OR_RETURN(target_, base::gl::RenderTarget::create(camera.width, camera.height));
    }
    target_.bind();
    LUMIGRID_TRY(viewer.draw(camera, now));
    return target_.read();
  }

 private:
  base::gl::RenderTarget target_;
};

}  // namespace compare
