#pragma once
// A render target with n × n samples a pixel and the pass that averages them.
#include <array>

#include "base/error.h"
#include "base/gl/gl.h"
#include "server/render/tiling.h"

namespace server {

/// Averages a pixel's samples: the colour is the mean over covered samples, alpha their share. So a pixel at a
/// silhouette has the model's colour, not darkened by the background.
class ResolvePass {
 public:
  static base::Result<ResolvePass> create();
  /// Averages the texture `samples` (n × n texels a pixel) into the framebuffer and viewport bound.
  void run(GLuint samples, int supersampling) const;

 private:
  /// Those that images and frames have: software GL takes far longer for loops whose length it does not know.
  static constexpr std::array<int, 2> kOwnPrograms{2, 4};
  std::array<base::gl::Program, kOwnPrograms.size()> own_;
  base::gl::Program any_;
  base::gl::WholeTarget whole_;
};

class SampleTarget {
 public:
  SampleTarget() = default;
  /// `width`, `height`: pixels; `supersampling`: 1..8. Each side times supersampling is at most maxSide().
  static base::Result<SampleTarget> create(int width, int height, int supersampling);
  /// Makes this a target of such a size, unless it is one already.
  base::Result<void> fit(int width, int height, int supersampling);
  /// Returns the longest side of a target that this GL allows, in samples.
  static int maxSide();

  /// Binds the target, sets the viewport, and clears to transparent black and the far plane.
  void begin() const;
  /// Binds the target and sets the viewport, to go on drawing.
  void resume() const;
  /// Averages the samples of a part (pixels, y from the top) and returns the framebuffer that contains width × height
  /// pixels. Those outside of the part are undefined.
  GLuint resolve(const ResolvePass& pass, const Tile& part) const;
  GLuint resolve(const ResolvePass& pass) const { return resolve(pass, {0, 0, width_, height_}); }
  int height() const { return height_; }
  GLuint framebuffer() const { return framebuffer_.name(); }  ///< the one that begin() binds

 private:
  base::gl::Texture samples_;
  base::gl::Renderbuffer depth_;
  base::gl::Framebuffer framebuffer_;
  base::gl::Renderbuffer resolved_;  ///< only with supersampling
  base::gl::Framebuffer resolved_framebuffer_;
  int width_ = 0;
  int height_ = 0;
  int supersampling_ = 0;
};

}  // namespace server
