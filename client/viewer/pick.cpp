#include "client/viewer/pick.h"

#include <array>
#include <glm/gtc/matrix_transform.hpp>
#include <string>

#include "base/bytes.h"
#include "client/viewer/shaders.h"

namespace client {
namespace {

/// Magnifies the pixel-sized square around (x, y) to the whole of clip space.
glm::mat4 clipOfPixel(const base::Camera& camera, double x, double y) {
  const float width = static_cast<float>(camera.width);
  const float height = static_cast<float>(camera.height);
  const glm::vec2 center(2.0F * static_cast<float>(x) / width - 1.0F, 1.0F - 2.0F * static_cast<float>(y) / height);
  const glm::mat4 scale = glm::scale(glm::mat4(1.0F), glm::vec3(width, height, 1.0F));
  return glm::translate(scale, glm::vec3(-center, 0.0F)) * camera.clipFromScene();
}

/// Returns the point on a pixel's ray at a given depth along the view axis.
glm::vec3 pointAtDepth(const base::Camera& camera, double x, double y, float eye_depth) {
  const glm::vec2 ndc(2.0F * static_cast<float>(x) / static_cast<float>(camera.width) - 1.0F,
                      1.0F - 2.0F * static_cast<float>(y) / static_cast<float>(camera.height));
  const glm::mat4& projection = camera.clip_from_eye;
  // Clip x = P00 x + P20 z + P30, with w = depth, or 1 in a parallel projection.
  const float w = camera.orthographic() ? 1.0F : eye_depth;
  const glm::vec3 eye_point((w * ndc.x + eye_depth * projection[2][0] - projection[3][0]) / projection[0][0],
                            (w * ndc.y + eye_depth * projection[2][1] - projection[3][1]) / projection[1][1],
                            -eye_depth);
  return glm::vec3(glm::inverse(camera.eye_from_scene) * glm::vec4(eye_point, 1.0F));
}

}  // namespace

base::Result<Picker> Picker::create() {
  LUMIGRID_ASSIGN_OR_RETURN(auto program, base::gl::Program::link("pick", glsl::kPickVertex, glsl::kPickFragment));
  Picker picker;
  picker.program_ = std::move(program);
  picker.framebuffer_ = base::gl::Framebuffer::create();
  picker.color_ = base::gl::Renderbuffer::create();
  picker.depth_ = base::gl::Renderbuffer::create();

  GLint bound = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &bound);
  base::gl::allocate(picker.color_, GL_RGBA32UI, 1, 1);
  base::gl::allocate(picker.depth_, GL_DEPTH_COMPONENT24, 1, 1);
  glBindFramebuffer(GL_FRAMEBUFFER, picker.framebuffer_.name());
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, picker.color_.name());
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, picker.depth_.name());
  const GLenum status = glCheckFramebufferStatus(GL_FRAMEBUFFER);
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(bound));
  if (status != GL_FRAMEBUFFER_COMPLETE)
    return base::Error{base::ErrorCode::kUnsupported, "pick: this GL cannot draw into unsigned integers (status " +
                                                          std::to_string(status) + "); update its driver"};
  return picker;
}

std::optional<glm::vec3> Picker::surfaceAt(const base::Camera& camera, double x, double y,
                                           const lod::draw::PatchMeshes& meshes,
                                           std::span<const std::uint32_t> cut) const {
  // Draw through the pixel.
  GLint bound = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &bound);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  glViewport(0, 0, 1, 1);
  glDisable(GL_BLEND);
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_TRUE);
  glDepthFunc(GL_LESS);
  const std::array<GLuint, 4> nothing{0, 0, 0, 0};
  glClearBufferuiv(GL_COLOR, 0, nothing.data());
  const GLfloat farthest = 1.0F;
  glClearBufferfv(GL_DEPTH, 0, &farthest);
  program_.use();
  const glm::mat4 clip = clipOfPixel(camera, x, y);
  glUniformMatrix4fv(program_.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip[0][0]);
  const glm::mat4& eye = camera.eye_from_scene;
  glUniform4f(program_.uniform("u_depth_from_scene"), -eye[0][2], -eye[1][2], -eye[2][2], -eye[3][2]);
  const glm::vec4& section = camera.section;
  glUniform4f(program_.uniform("u_section"), section.x, section.y, section.z, section.w);
  meshes.draw(cut);

  // Read back the pixel.
  std::array<GLuint, 4> pixel{0, 0, 0, 0};
  glReadPixels(0, 0, 1, 1, GL_RGBA_INTEGER, GL_UNSIGNED_INT, pixel.data());
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(bound));
  if (pixel[1] == 0) return std::nullopt;
  return pointAtDepth(camera, x, y, base::bitCast<float>(pixel[0]));
}

}  // namespace client
