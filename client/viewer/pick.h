#pragma once
// The surface under the cursor: the drawn patches once more, through one pixel, with their depth as colour. WebGL2
// can't read a depth buffer, hence the colour.
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
  /// The scene-local point shown at (x, y), in pixels from the upper left corner (the first pixel is centred at 0.5,
  /// 0.5); nullopt where there is background. Waits for the GPU: for clicks and wheel steps, not for every frame.
  /// Restores the framebuffer binding.
  /// What `section` cuts away (base::sectionInScene) is not there.
  std::optional<glm::vec3> surfaceAt(const base::Camera& camera, double x, double y,
                                     const lod::draw::PatchMeshes& meshes, std::span<const std::uint32_t> cut,
                                     const glm::vec4& section = base::kNoSection) const;
  std::uint64_t gpuBytes() const { return color_.bytes() + depth_.bytes(); }

 private:
  base::gl::Program program_;
  base::gl::Framebuffer framebuffer_;
  base::gl::Renderbuffer color_;
  base::gl::Renderbuffer depth_;
};

}  // namespace client
