#pragma once
// What umbrellas and nodes have in common when they are drawn: the view, the target, and the program in its variants.
#include <array>
#include <cstddef>
#include <string>

#include "base/camera.h"
#include "base/error.h"
#include "base/gl/gl.h"
#include "lod/draw/triangles.h"

namespace lod::draw {

struct SurfaceView {
  base::Camera camera;  ///< perspective, off-axis too, or parallel
  Shading shading;
  glm::vec4 section = base::kNoSection;  ///< everything beyond it is cut away
  /// kResolutionLegend by the size on the screen of the detail that is shown, hatched with dark lines where a finer
  /// level is still to come; otherwise the colours of the scan, shaded.
  bool resolution_colors = false;
};

struct SurfaceTarget {
  GLuint framebuffer = 0;  ///< colour and depth, cleared or with a picture to draw into
  int width = 0;           ///< samples; the camera's picture covers all of them
  int height = 0;

  bool empty() const { return width <= 0 || height <= 0; }
  /// Samples that a pixel of the camera's picture spans.
  float samplesPerPixel(const base::Camera& camera) const;
};

enum class Primitive : std::uint8_t { kTriangles, kPoints, kLines };

/// A variant of the program.
struct SurfacePass {
  Primitive primitive = Primitive::kTriangles;
  bool resolution = false;  ///< coloured by resolution
  bool section = false;
  int shadow_layers = 0;  ///< of the shadow map, 1, 2, 4, 8 or 16; 0: no shadows

  static SurfacePass of(Primitive primitive, const SurfaceView& view);
  std::size_t number() const;
  static constexpr std::size_t kNumbers = 72;
};

class SurfacePrograms {
 public:
  /// `name`: for GL's messages. `shade_fragments`: shading is computed for each fragment, else for each vertex.
  /// `shadow_source`: GLSL of passes with shadows (ShadowMaps::shadingSource()), which shade fragments.
  SurfacePrograms(std::string name, bool shade_fragments, std::string shadow_source = {})
      : name_(std::move(name)), shade_fragments_(shade_fragments), shadow_source_(std::move(shadow_source)) {}

  /// Links the variant when it is first needed.
  base::Result<const base::gl::Program*> link(const SurfacePass& pass);
  /// Links it, uses it, and sets what it needs to know of view and target. The caller sets "u_two_sided" where vertices
  /// are shaded, "u_closing" for points and lines, "u_detail" and "u_hatched" with resolution, and "u_copies" for
  /// lines: their meanings are in shaders/surface_vertex.glsl. With shadows follows ShadowMaps::use().
  base::Result<const base::gl::Program*> use(const SurfacePass& pass, const SurfaceView& view,
                                             const SurfaceTarget& target);

 private:
  const std::string name_;
  const bool shade_fragments_;
  const std::string shadow_source_;
  std::array<base::gl::Program, SurfacePass::kNumbers> programs_;  ///< by SurfacePass::number()
};

/// Binds the target and sets the state for surfaces of which both sides are seen. The depth test (less) stays enabled.
void beginSurfaces(const SurfaceTarget& target);

}  // namespace lod::draw
