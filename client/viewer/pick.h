#pragma once
// Finds the surface under the cursor by drawing the patches once more, through one pixel, with their depth as colour.
// The colour is needed because WebGL2 cannot read a depth buffer.
#include <glm/glm.hpp>
#include <optional>
#include <span>

#include "base/camera.h"
#include "base/error.h"
#include "base/gl/gl.h"
#include "lod/draw/triangles.h"

namespace client {

class Picker {
 public:
  static base::Result<Picker> create();
  /// Returns the scene-local point shown at (x, y), in pixels from the upper left corner (the first pixel is centred at
  /// 0.5, 0.5), or nullopt over background. Waits for the GPU, so it suits clicks and wheel steps but not every frame.
  /// Restores the framebuffer binding. Surface that the camera's section cuts away is not hit.
  std::optional<glm::vec3> surfaceAt(const base::Camera& camera, double x, double y,
                                     const lod::draw::PatchMeshes& meshes, std::span<const std::uint32_t> cut) const;
  std::uint64_t gpuBytes() const { return color_.bytes() + depth_.bytes(); }

 private:
  base::gl::Program program_;
  base::gl::Framebuffer framebuffer_;
  base::gl::Renderbuffer color_;
  base::gl::Renderbuffer depth_;
};

}  // namespace client
