#include "base/gl/multisampled_target.h"

#include <string>

#include "base/check.h"

namespace base::gl {
namespace {

Renderbuffer storage(GLenum attachment, GLenum format, int width, int height, int samples) {
  auto buffer = Renderbuffer::create();
  glBindRenderbuffer(GL_RENDERBUFFER, buffer.name());
  // One sample is written as none, since a GL may round up what is asked for.
  glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples > 1 ? samples : 0, format, width, height);
  buffer.setStorageBytes(MultisampledTarget::bytesOf(width, height, samples) / 2);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachment, GL_RENDERBUFFER, buffer.name());
  return buffer;
}

}  // namespace

Result<MultisampledTarget> MultisampledTarget::create(int width, int height, int samples) {
  MultisampledTarget target;
  target.width_ = width, target.height_ = height, target.samples_ = samples;
  target.framebuffer_ = Framebuffer::create();
  GLint bound = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &bound);
  glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer_.name());
  target.color_ = storage(GL_COLOR_ATTACHMENT0, GL_RGBA8, width, height, samples);
  target.depth_ = storage(GL_DEPTH_ATTACHMENT, GL_DEPTH_COMPONENT24, width, height, samples);
  glBindRenderbuffer(GL_RENDERBUFFER, 0);
  const bool complete = glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(bound));
  if (complete) return target;
  return Error{ErrorCode::kNoSpace, "a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                                        " pixels with " + std::to_string(samples) +
                                        " samples each: the GL refuses it (" + takeError() +
                                        "); pictures are drawn whole, with one sample"};
}

void MultisampledTarget::bind() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
}

void MultisampledTarget::resolveTo(GLuint framebuffer, int width, int height) const {
  LUMIGRID_CHECK(samples_ <= 1 || (width == width_ && height == height_));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer_.name());
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
  const bool same = width == width_ && height == height_;
  glBlitFramebuffer(0, 0, width_, height_, 0, 0, width, height, GL_COLOR_BUFFER_BIT, same ? GL_NEAREST : GL_LINEAR);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(0, 0, width, height);
}

}  // namespace base::gl
