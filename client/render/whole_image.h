#pragma once
// Shows an image as it is, pixel for pixel, over what is drawn already.
#include <array>

#include "base/error.h"
#include "base/gl/gl.h"

namespace client {

class WholeImageShader {
 public:
  static base::Result<WholeImageShader> create();

  /// Draws level 0 of a layer of an array texture into the bound framebuffer, viewport 0,0 … width × height: texel (x,
  /// y) becomes pixel (x, y), both counted from the bottom. Texels are premultiplied and lie over `background` (RGBA, 0
  /// … 1); the result takes the place of what was there, or is mixed with it by `opacity` below 1. Leaves depth as it
  /// is.
  void draw(GLuint array, int layer, int width, int height, const std::array<float, 4>& background,
            float opacity) const;
  /// Sets the alpha of all that is nearer than the far plane to 1, each sample by itself. `array` is any texture that
  /// is complete.
  void makeOpaque(GLuint array) const;

 private:
  void cover(GLuint array, int layer, const std::array<float, 4>& background) const;

  WholeImageShader(base::gl::Program program);
  base::gl::Program program_;
  base::gl::WholeTarget whole_;
};

}  // namespace client
