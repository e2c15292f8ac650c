#pragma once
// Draws splats with OpenGL ES (Rusinkiewicz and Levoy 2000, section 3.3), for the server and the client.
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/camera.h"
#include "base/gl/gl.h"
#include "lod/draw/triangles.h"
#include "lod/qsplat/splat.h"

namespace lod::draw {

/// Shapes of a splat. All but the ellipse cover the whole projection of their sphere, also where perspective stretches
/// it, and so leave no hole in a closed surface.
enum class SplatKernel {
  kSquare,  ///< the fastest
  kCircle,  ///< the sphere's outline
  kFuzzy,   ///< opacity falls from the centre along a spline, 1/2 at the outline; splats of a pixel are averaged
  /// A disc that lies in the surface, foreshortened to a tenth at most: the sharpest, but it may leave small holes.
  kEllipse,
};
inline constexpr std::array<std::pair<SplatKernel, std::string_view>, 4> kSplatKernelNames{
    {{SplatKernel::kSquare, "square"},
     {SplatKernel::kCircle, "circle"},
     {SplatKernel::kFuzzy, "fuzzy"},
     {SplatKernel::kEllipse, "ellipse"}}};
inline std::optional<SplatKernel> splatKernelFromName(std::string_view name) {
  for (const auto& [kernel, text] : kSplatKernelNames)
    if (text == name) return kernel;
  return std::nullopt;
}

enum class SplatColors {
  kSurface,  ///< colours of the scan, shaded
  /// kResolutionLegend by projected diameter, hatched with dark lines where the splat stands in for finer ones that are
  /// still to come (Rusinkiewicz and Levoy 2001, section 4.1).
  kResolution,
};

struct SplatView {
  base::Camera camera;  ///< perspective, off-axis too, or parallel
  Shading shading;
  bool two_sided = false;  ///< normals that face away are flipped; set where back faces were not culled
  SplatColors colors = SplatColors::kSurface;
};

struct SplatTarget {
  GLuint framebuffer = 0;  ///< colour and depth, cleared or with a picture of the same near plane
  int width = 0;           ///< samples; the camera's picture covers all of them
  int height = 0;
  /// Whether soft edges of fuzzy and enlarged pictures are blended over the target. Otherwise they are written with
  /// their coverage as alpha and the colour not multiplied by it.
  bool mix = true;
  /// Pixels a sample on each side, at least 1. Above 1 the picture is drawn with fewer samples and enlarged, which
  /// saves most of the time where large splats cover it many times.
  float reduction = 1.0F;
};

class SplatRenderer {
 public:
  /// Needs a current context, as do the other functions.
  static base::Result<std::unique_ptr<SplatRenderer>> create();
  /// Uploads and draws the splats, with the near plane moved out to them (NearFit). The depth test (less) stays
  /// enabled; of two splats at the same depth either is seen. Keeps 20 bytes a splat on the GPU and as many in memory
  /// until the next call, and 8 bytes a pixel of the last reduced target (kFuzzy: 12, of any target). kUnsupported,
  /// with nothing drawn: kFuzzy on a GL without half-float targets (EXT_color_buffer_float or
  /// EXT_color_buffer_half_float).
  base::Result<void> draw(std::span<const qsplat::Splat> splats, SplatKernel kernel, const SplatView& view,
                          const SplatTarget& target);
  /// The camera of the last draw(), by which the depths in its target are made.
  const base::Camera& drawnCamera() const { return drawn_camera_; }

 private:
  struct Pass;
  /// An intermediate picture for fuzzy splats and for reduced ones.
  struct Canvas {
    base::gl::Texture color, depth;
    base::gl::Framebuffer framebuffer;
    GLenum format = 0;
    int width = 0, height = 0;
  };
  SplatRenderer() = default;
  void upload(std::span<const qsplat::Splat> splats, float max_point_samples, const SplatView& view,
              const SplatTarget& target);
  base::Result<const base::gl::Program*> program(const Pass& pass);
  base::Result<void> drawPass(Pass pass, const SplatView& view, const SplatTarget& target);
  base::Result<void> drawShape(const Pass& pass, const SplatView& view, const SplatTarget& target);
  base::Result<void> drawFuzzy(const SplatView& view, const SplatTarget& reduced);
  base::Result<void> prepareCanvas(GLenum format, int width, int height);
  void compose(const SplatTarget& reduced, const SplatTarget& target);

  std::array<base::gl::Program, 32> programs_;  ///< by Pass::number(), linked when first needed
  base::gl::Program compose_;
  base::gl::WholeTarget whole_;
  Canvas canvas_;

  base::Camera drawn_camera_;
  std::vector<qsplat::Splat> sorted_;  ///< splats drawn as points, then the others
  std::size_t points_ = 0;
  base::gl::Buffer buffer_;
  base::gl::VertexArray as_points_, as_quads_;
  std::size_t capacity_ = 0;
  float largest_point_ = 1.0F;
};

}  // namespace lod::draw
