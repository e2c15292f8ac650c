#pragma once
// A render target with n × n samples a pixel and the pass that averages them.
#include "base/error.h"
#include "base/gl/gl.h"
#include "server/render/tiling.h"

namespace server {

/// Averages a pixel's samples: colour over the covered ones only, alpha = covered share. So a pixel at a silhouette has
/// the model's colour, not one darkened by the background.
class ResolvePass {
 public:
  static base::Result<ResolvePass> create();
  /// From `samples` (n × n texels a pixel) to the framebuffer and viewport bound.
  void run(GLuint samples, int supersampling) const;

 private:
  base::gl::Program program_;
  base::gl::VertexArray array_;
};

class SampleTarget {
 public:
  SampleTarget() = default;
  /// width, height: pixels; supersampling 1..8. Each side times supersampling at most maxSide().
  static base::Result<SampleTarget> create(int width, int height, int supersampling);
  /// Longest side of a target here, in samples.
  static int maxSide();

  /// Binds, sets the viewport, clears to transparent black and the far plane.
  void begin() const;
  /// Averages the samples of a part (pixels, y from the top) and returns the framebuffer that holds width × height
  /// pixels, of which those outside the part mean nothing.
  GLuint resolve(const ResolvePass& pass, const Tile& part) const;
  GLuint resolve(const ResolvePass& pass) const { return resolve(pass, {0, 0, width_, height_}); }
  bool matches(int width, int height, int supersampling) const {
    return width_ == width && height_ == height && supersampling_ == supersampling;
  }
  int height() const { return height_; }
  GLuint framebuffer() const { return framebuffer_.name(); }  ///< that begin() binds

 private:
  base::gl::Texture samples_;
  base::gl::Renderbuffer depth_;
  base::gl::Framebuffer framebuffer_;
  base::gl::Renderbuffer resolved_;  ///< with supersampling only
  base::gl::Framebuffer resolved_framebuffer_;
  int width_ = 0;
  int height_ = 0;
  int supersampling_ = 0;
};

}  // namespace server
