#pragma once
// Blends each pixel of the proxy once, whatever triangles lie in it: the surfaces that pixels show are kept in
// textures, and one more pass over the picture blends what images know of each (deferred shading; Saito, Takahashi
// 1990, "Comprehensible Rendering of 3-D Shapes"). docs/decisions/blend-once.md says why, and what it costs.
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/gl/gl.h"
#include "client/render/lumigraph.h"
#include "client/render/patch_samples.h"

namespace client {

/// The binding point of the frame's samples, and what binds a program's block `Samples` to it.
inline constexpr GLuint kSamplesBinding = 0;
void bindSamples(const base::gl::Program& program);

class PixelBlend {
 public:
  static base::Result<PixelBlend> create();

  /// Patches of a picture at most.
  static constexpr std::size_t kMostPatches = 65535;
  /// Surfaces that are blended for a pixel at most: the foremost, and the one behind it where that is carved or has its
  /// edge.
  static constexpr std::size_t kLayers = 2;

  /// Returns the bytes of the textures for pictures of this size.
  static std::uint64_t bytesOf(int width, int height);
  std::uint64_t bytes() const;
  /// Allocates them; false if the GL refuses. What was blended before is lost where the size changes.
  bool prepare(int width, int height);

  /// Takes the program for the powers of this tuning, and links it at the first time. `one_array`: all samples of the
  /// frame are in one array of images. False if the GL refuses.
  bool chooseBlend(const BlendTuning& tuning, bool one_array);
  /// The programs that keep surfaces, blend them, draw the proxy without and with the result, and make it a picture of
  /// one sample a pixel. All have the uniforms of the view; the second also those of the samples and the tuning.
  const base::gl::Program& surface() const { return surface_; }
  const base::gl::Program& blend() const { return blends_.at(blend_).second; }
  const base::gl::Program& shade() const { return shade_; }
  const base::gl::Program& show() const { return show_; }
  const base::gl::Program& picture() const { return picture_; }

  // A layer's turn: beginSurface(), drawing each patch after setPatch(), blendPixels(), perhaps compose(); then the
  // next layer's. The programs must be in use; texture units from `unit` on are free.

  /// Makes the layer's textures, cleared, the target of surface(). Behind the first layer only pixels where that wants
  /// another are drawn, until blendPixels().
  void beginSurface(std::size_t layer, int unit) const;
  /// Clears the layer's textures.
  void clearSurface(std::size_t layer) const;
  /// Tells the place in the draw order of the patch that is drawn next.
  void setPatch(std::size_t place) const;
  /// Tells for each place in the draw order the patch's typical errors, and the samples that may see its cells.
  void setLists(std::span<const ProxyError> errors, std::span<const PatchCells> cells);
  /// Blends the layer by blend().
  void blendPixels(std::size_t layer, int unit) const;

  /// Draws the layer by picture() into the framebuffer bound now, where nothing is nearer.
  void compose(std::size_t layer, int unit) const;

  /// Sets the uniforms of show().
  void setResult(int unit) const;

 private:
  struct Layer {
    base::gl::Texture depth, images, coverage;
    base::gl::Framebuffer surface, blend;
  };
  PixelBlend() = default;
  /// All that the source of a blending program depends on.
  struct BlendKey {
    float angle_power, vote_power, resolution_power;
    bool one_array;

    friend bool operator==(const BlendKey&, const BlendKey&) = default;
  };
  static base::Result<base::gl::Program> linkBlend(const std::string& source);
  void keepToWanted(const Layer& front, int unit) const;

  base::gl::Program surface_;
  base::gl::Program wanted_;
  base::gl::Program shade_;
  base::gl::Program show_;
  base::gl::Program picture_;
  std::vector<std::pair<BlendKey, base::gl::Program>> blends_;
  std::size_t blend_ = 0;  ///< of them
  base::gl::WholeTarget whole_;
  base::gl::Texture color_, normals_, patch_, depth_;  ///< of the surface that is blended next; depth and stencil
  base::gl::Texture patches_, cells_, lists_;
  std::array<Layer, kLayers> layers_;
  std::size_t patch_count_ = 0;
  int width_ = 0, height_ = 0;
};

}  // namespace client
