#include "client/render/whole_image.h"

#include <utility>

#include "client/render/shaders.h"

namespace client {

base::Result<WholeImageShader> WholeImageShader::create() {
  LUMIGRID_ASSIGN_OR_RETURN(auto program,
                            base::gl::Program::link("whole image", glsl::kWholeVertex, glsl::kWholeFragment));
  return WholeImageShader(std::move(program));
}

WholeImageShader::WholeImageShader(base::gl::Program program)
    : program_(std::move(program)), whole_(base::gl::WholeTarget::create()) {}

void WholeImageShader::draw(GLuint array, int layer, int width, int height, const std::array<float, 4>& background,
                            float opacity) const {
  glViewport(0, 0, width, height);
  glDisable(GL_DEPTH_TEST);
  if (opacity < 1.0F) {
    glEnable(GL_BLEND);
    glBlendColor(0.0F, 0.0F, 0.0F, opacity);
    glBlendFunc(GL_CONSTANT_ALPHA, GL_ONE_MINUS_CONSTANT_ALPHA);
  }
  cover(array, layer, background);
  glDisable(GL_BLEND);
  glEnable(GL_DEPTH_TEST);
}

void WholeImageShader::makeOpaque(GLuint array) const {
  glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_TRUE);
  glDepthMask(GL_FALSE);
  glDepthFunc(GL_GREATER);
  cover(array, 0, {0.0F, 0.0F, 0.0F, 1.0F});
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

/// Draws a triangle over the whole viewport, at the far plane.
void WholeImageShader::cover(GLuint array, int layer, const std::array<float, 4>& background) const {
  program_.use();
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(GL_TEXTURE_2D_ARRAY, array);
  glUniform1i(program_.uniform("u_color"), 0);
  glUniform1i(program_.uniform("u_layer"), layer);
  glUniform4f(program_.uniform("u_background"), background[0], background[1], background[2], background[3]);
  whole_.draw();
}

}  // namespace client
