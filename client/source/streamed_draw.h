#pragma once
// The functions by which the views of all streamed methods draw and pick.
#include <array>

#include "base/camera.h"

namespace client {

/// Clears colour and depth of the framebuffer bound now.
void clearPicture(const std::array<float, 4>& background);
/// Waits until the GPU is done with the framebuffer bound now.
void waitForGpu();

/// The ray of scene-local points that are seen at a place in the picture, from the near plane on.
struct SceneRay {
  glm::dvec3 origin{0.0};
  glm::dvec3 direction{0.0};  ///< unit
};
/// `x` and `y`: pixels from the upper left corner.
SceneRay rayThrough(const base::Camera& camera, double x, double y);

}  // namespace client
