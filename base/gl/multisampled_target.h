#pragma once
// A picture of several samples a pixel, or of another size, which goes into a framebuffer once it is drawn.
#include <cstdint>

#include "base/gl/gl.h"

namespace base::gl {

/// RGBA8 colour and 24-bit depth.
class MultisampledTarget {
 public:
  MultisampledTarget() = default;
  /// Error where the GL cannot hold it: kNoSpace.
  static Result<MultisampledTarget> create(int width, int height, int samples);

  /// Makes it the target of what is drawn next.
  void bind() const;
  /// Writes the mean of each pixel's samples into the framebuffer, which has no samples and RGBA8 colour, and leaves
  /// that one bound, all of it the viewport. Pixels that are covered in part get a colour premultiplied by their alpha,
  /// if the background is transparent black. A picture of one sample a pixel is filtered where the framebuffer's
  /// width × height is another; with several samples it must be the same.
  void resolveTo(GLuint framebuffer, int width, int height) const;

  bool fits(int width, int height, int samples) const {
    return width == width_ && height == height_ && samples == samples_;
  }
  std::uint64_t bytes() const { return color_.bytes() + depth_.bytes(); }
  /// The same of a target that is not made yet.
  static std::uint64_t bytesOf(int width, int height, int samples) {
    return std::uint64_t{8} * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height) *
           static_cast<std::uint64_t>(samples);
  }

 private:
  Framebuffer framebuffer_;
  Renderbuffer color_;
  Renderbuffer depth_;
  int width_ = 0, height_ = 0, samples_ = 0;
};

}  // namespace base::gl
