#include "server/render/readback.h"

#include <cstring>

namespace server {
namespace {

// After kMaxWaits waits of this length the GPU is considered hung.
constexpr GLuint64 kWaitNanoseconds = 1'000'000'000;
constexpr int kMaxWaits = 120;

base::Error readbackError(const char* problem) {
  return {base::ErrorCode::kIo, std::string("reading a picture back: ") + problem + " (" + base::gl::takeError() +
                                    "); restart with a smaller GPU budget"};
}

}  // namespace

ReadbackQueue::~ReadbackQueue() {
  drop();
}

void ReadbackQueue::drop() {
  for (Entry& entry : entries_)
    if (entry.fence != nullptr) glDeleteSync(entry.fence);
  entries_.clear();
  in_flight_ = 0;
}

base::Result<void> ReadbackQueue::read(const std::shared_ptr<PendingPicture>& picture, const Tile& tile,
                                       GLuint framebuffer, int left, int bottom) {
  Entry entry{picture, tile, {}, nullptr};
  if (spare_.empty()) {
    entry.pixels = base::gl::Buffer::create();
  } else {
    entry.pixels = std::move(spare_.back());
    spare_.pop_back();
  }

  glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer);
  base::gl::allocate(entry.pixels, GL_PIXEL_PACK_BUFFER, nullptr,
                     static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height) * 4, GL_STREAM_READ);
  glPixelStorei(GL_PACK_ALIGNMENT, 4);
  glReadPixels(left, bottom, tile.width, tile.height, GL_RGBA, GL_UNSIGNED_BYTE, nullptr);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  entry.fence = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
  glFlush();

  entries_.push_back(std::move(entry));
  ++in_flight_;
  while (in_flight_ >= depth_) LUMIGRID_TRY(deliverOldest());
  return {};
}

base::Result<void> ReadbackQueue::skip(const std::shared_ptr<PendingPicture>& picture) {
  entries_.push_back({picture, {}, {}, nullptr});
  // If nothing is in flight before it, it can be delivered at once.
  while (in_flight_ == 0 && !entries_.empty()) LUMIGRID_TRY(deliverOldest());
  return {};
}

base::Result<void> ReadbackQueue::finish() {
  while (!entries_.empty()) LUMIGRID_TRY(deliverOldest());
  return {};
}

base::Result<void> ReadbackQueue::deliverOldest() {
  Entry entry = std::move(entries_.front());
  entries_.pop_front();
  if (entry.pixels) {
    --in_flight_;
    base::Result<void> copied = copyPixels(entry);
    glDeleteSync(entry.fence);
    if (!copied) return copied;
    spare_.push_back(std::move(entry.pixels));
  }
  PendingPicture& picture = *entry.picture;
  if (--picture.tiles_left == 0) picture.deliver(std::move(picture.rendered));
  return {};
}

base::Result<void> ReadbackQueue::copyPixels(const Entry& entry) {
  GLenum state = GL_TIMEOUT_EXPIRED;
  for (int i = 0; i < kMaxWaits && state == GL_TIMEOUT_EXPIRED; ++i)
    state = glClientWaitSync(entry.fence, GL_SYNC_FLUSH_COMMANDS_BIT, kWaitNanoseconds);
  if (state != GL_ALREADY_SIGNALED && state != GL_CONDITION_SATISFIED) return readbackError("the GPU does not answer");

  const std::size_t row = static_cast<std::size_t>(entry.tile.width) * 4;
  const std::size_t bytes = row * static_cast<std::size_t>(entry.tile.height);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, entry.pixels.name());
  const auto* pixels = static_cast<const std::uint8_t*>(
      glMapBufferRange(GL_PIXEL_PACK_BUFFER, 0, static_cast<GLsizeiptr>(bytes), GL_MAP_READ_BIT));
  if (pixels == nullptr) {
    glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
    return readbackError("its pixel buffer can't be mapped");
  }

  // GL's first row is at the bottom, the image's at the top.
  base::Image& image = entry.picture->rendered.rgba;
  for (int y = 0; y < entry.tile.height; ++y)
    std::memcpy(image.at(entry.tile.x, entry.tile.y + y),
                pixels + row * static_cast<std::size_t>(entry.tile.height - 1 - y), row);
  const GLboolean intact = glUnmapBuffer(GL_PIXEL_PACK_BUFFER);
  glBindBuffer(GL_PIXEL_PACK_BUFFER, 0);
  if (intact != GL_TRUE) return readbackError("its pixel buffer was lost");
  return {};
}

}  // namespace server
