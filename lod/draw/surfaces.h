#pragma once
// Umbrellas and nodes share a view, a target, and a program in its variants when they are drawn.
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
  /// kResolutionLegend by the size on the screen of the detail that is shown, hatched with dark lines where a finer
  /// level is still to come; otherwise the colours of the scan, shaded.
  bool resolution_colors = false;
};

struct SurfaceTarget {
  GLuint framebuffer = 0;  ///< colour and depth, cleared or with a picture of the same near plane
  int width = 0;           ///< samples; the camera's picture covers all of them
  int height = 0;

  bool empty() const { return width <= 0 || height <= 0; }
  /// Samples that a pixel of the camera's picture spans.
  float samplesPerPixel(const base::Camera& camera) const;
};

enum class Primitive : std::uint8_t { kTriangles, kPoints, kLines };

/// How a method's surfaces are drawn.
struct SurfaceStyle {
  const char* name = "";           ///< for GL's messages
  bool shade_fragments = false;    ///< shading is computed for each fragment, else for each vertex
  bool fill_behind = false;        ///< points and lines lie behind triangles by three times their size
  bool backs_behind = false;       ///< what turns its back to the eye lies behind by the uniform "u_back"
  std::string shadow_source = {};  ///< GLSL of passes with shadows (ShadowMap::shadingSource()), which shade fragments
};

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
  explicit SurfacePrograms(SurfaceStyle style) : style_(std::move(style)) {}

  /// Links the variant when it is first needed.
  base::Result<const base::gl::Program*> link(const SurfacePass& pass);
  /// Links it, uses it, and sets what it needs to know of view and target. The caller sets "u_two_sided" where vertices
  /// are shaded, "u_closing" for points and lines, "u_point_samples" for points, "u_detail" and "u_hatched" with
  /// resolution, "u_back" where backs lie behind, and "u_copies" for lines: their meanings are in
  /// shaders/surface_vertex.glsl. With shadows follows ShadowMap::use().
  base::Result<const base::gl::Program*> use(const SurfacePass& pass, const SurfaceView& view,
                                             const SurfaceTarget& target);

 private:
  const SurfaceStyle style_;
  std::array<base::gl::Program, SurfacePass::kNumbers> programs_;  ///< by SurfacePass::number()
};

/// Binds the target and sets the state for surfaces of which both sides are seen. The depth test (less) stays enabled.
void beginSurfaces(const SurfaceTarget& target);

}  // namespace lod::draw
