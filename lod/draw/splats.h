#pragma once
// Splats on the GPU (Rusinkiewicz and Levoy 2000, section 3.3). One class serves server and client.
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

/// What a splat looks like. All but the ellipse cover the whole projection of their sphere, also where perspective
/// stretches it, and so leave no hole in a closed surface.
enum class SplatKernel {
  kSquare,  ///< the fastest
  kCircle,  ///< the sphere's outline
  kFuzzy,  ///< opacity falls from the centre along a spline, 1/2 at the outline; what is drawn on one pixel is averaged
  kEllipse,  ///< a disc that lies in the surface, foreshortened to a tenth at most: the sharpest, with holes now and
             ///< then
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
  kSurface,     ///< the scan's, shaded
  kResolution,  ///< kResolutionLegend's, by the pixels that a splat spans (Rusinkiewicz and Levoy 2001, section 4.1)
};

struct SplatView {
  base::Camera camera;  ///< perspective, off-axis too, or parallel
  Shading shading;
  glm::vec4 section = base::kNoSection;  ///< what lies beyond is cut away
  bool two_sided = false;                ///< normals that lean away are turned over: where back faces were not culled
  SplatColors colors = SplatColors::kSurface;
};

struct SplatTarget {
  GLuint framebuffer = 0;  ///< with colour and depth; both cleared, or with a picture to draw into
  int width = 0;           ///< samples: the camera's picture is drawn over all of them
  int height = 0;
  /// Fuzzy and enlarged edges are mixed with what is there; otherwise they are written as they are, with coverage as
  /// alpha and colour not multiplied by it.
  bool mix = true;
  /// At least 1. Above, the picture is drawn with so many times fewer samples a side, and enlarged: where large splats
  /// fill it many times over, that is most of the time.
  float reduction = 1.0F;
};

class SplatRenderer {
 public:
  /// Needs a current context, and so do the others.
  static base::Result<std::unique_ptr<SplatRenderer>> create();
  /// Uploads and draws, with depth test (less), which stays on; where two are at one depth, either is seen. 20 bytes a
  /// splat are kept on the GPU, and as many here, until the next call; and 8 bytes a pixel of the last target that was
  /// reduced (kFuzzy: 12, of any). kUnsupported, with nothing drawn: kFuzzy where the GL has no half-float targets
  /// (EXT_color_buffer_float or EXT_color_buffer_half_float).
  base::Result<void> draw(std::span<const qsplat::Splat> splats, SplatKernel kernel, const SplatView& view,
                          const SplatTarget& target);

 private:
  struct Pass;
  /// What is not drawn into the target itself.
  struct Canvas {
    base::gl::Texture color, depth;
    base::gl::Framebuffer framebuffer;
    GLenum format = 0;
    int width = 0, height = 0;
  };
  SplatRenderer() = default;
  void upload(std::span<const qsplat::Splat> splats, float most_samples, const SplatView& view,
              const SplatTarget& target);
  base::Result<const base::gl::Program*> program(const Pass& pass);
  base::Result<void> drawPass(Pass pass, const SplatView& view, const SplatTarget& target);
  base::Result<void> drawShape(const Pass& pass, const SplatView& view, const SplatTarget& target);
  base::Result<void> drawFuzzy(const SplatView& view, const SplatTarget& own);
  base::Result<void> prepareCanvas(GLenum format, int width, int height);
  void compose(const SplatTarget& own, const SplatTarget& target);

  std::array<base::gl::Program, 32> programs_;  ///< by Pass::number(), made when first needed
  base::gl::Program compose_;
  base::gl::VertexArray no_attributes_;
  Canvas canvas_;

  std::vector<qsplat::Splat> sorted_;  ///< those drawn as points, then the others
  std::size_t points_ = 0;
  base::gl::Buffer buffer_;
  base::gl::VertexArray as_points_, as_quads_;
  std::size_t capacity_ = 0;
  float largest_point_ = 1.0F;
};

}  // namespace lod::draw
