#include "client/source/streamed_draw.h"

namespace client {

void clearPicture(const std::array<float, 4>& background) {
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glClearColor(background[0], background[1], background[2], background[3]);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
}

/// Reading a pixel waits on every platform; glFinish does not in browsers. Where pixels have several samples, one of
/// them is resolved first, since others cannot be read.
void waitForGpu() {
  std::array<std::uint8_t, 4> pixel{};
  const auto readPixel = [&] { glReadPixels(0, 0, 1, 1, GL_RGBA, GL_UNSIGNED_BYTE, pixel.data()); };
  GLint samples = 0;
  glGetIntegerv(GL_SAMPLES, &samples);
  if (samples == 0) return readPixel();
  GLint drawn = 0;
  std::array<GLint, 4> viewport{};
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &drawn);
  glGetIntegerv(GL_VIEWPORT, viewport.data());
  if (const auto one = base::gl::RenderTarget::create(1, 1)) {
    one->bind();
    glBindFramebuffer(GL_READ_FRAMEBUFFER, static_cast<GLuint>(drawn));
    glBlitFramebuffer(0, 0, 1, 1, 0, 0, 1, 1, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, one->framebuffer());
    readPixel();
  }
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(drawn));
  glViewport(viewport[0], viewport[1], viewport[2], viewport[3]);
}

void PictureFence::set() {
  remove();
  sync_ = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
}

bool PictureFence::hasPassed() {
  if (sync_ == nullptr || glClientWaitSync(sync_, GL_SYNC_FLUSH_COMMANDS_BIT, 0) == GL_TIMEOUT_EXPIRED) return false;
  remove();
  return true;
}

void PictureFence::remove() {
  if (sync_ != nullptr) glDeleteSync(sync_);
  sync_ = nullptr;
}

}  // namespace client
