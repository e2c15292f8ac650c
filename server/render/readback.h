#pragma once
// Pixels back from the GPU without waiting for each picture: a ring of pixel buffers with fences.
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "base/error.h"
#include "base/gl/gl.h"
#include "server/render/scene_renderer.h"
#include "server/render/tiling.h"

namespace server {

/// A picture on its way back, in one or more tiles.
struct PendingPicture {
  RenderedPicture rendered;  ///< pixels transparent black until tiles arrive
  std::size_t tiles_left = 0;
  std::function<void(RenderedPicture)> take;
};

/// Delivers pictures in the order in which they were begun.
class ReadbackQueue {
 public:
  /// `depth`: tiles in flight before the oldest is waited for.
  explicit ReadbackQueue(std::size_t depth) : depth_(depth) {}
  ~ReadbackQueue();
  ReadbackQueue(const ReadbackQueue&) = delete;
  ReadbackQueue& operator=(const ReadbackQueue&) = delete;

  /// Starts to read a tile of the picture from `framebuffer`, where its lowest left pixel (GL's way up) is (left,
  /// bottom). May deliver older pictures.
  base::Result<void> read(const std::shared_ptr<PendingPicture>& picture, const Tile& tile, GLuint framebuffer,
                          int left, int bottom);
  /// A tile that shows nothing: keeps its place in the order, costs no transfer.
  base::Result<void> skip(const std::shared_ptr<PendingPicture>& picture);
  /// Waits for and delivers all.
  base::Result<void> finish();
  /// Forgets all that is on its way; nothing of it is delivered.
  void drop();

 private:
  struct Entry {
    std::shared_ptr<PendingPicture> picture;
    Tile tile;
    base::gl::Buffer pixels;  ///< no name: skipped
    GLsync fence = nullptr;
  };
  base::Result<void> deliverOldest();
  static base::Result<void> copyPixels(const Entry& entry);

  std::size_t depth_;
  std::size_t in_flight_ = 0;
  std::deque<Entry> entries_;
  std::vector<base::gl::Buffer> spare_;
};

}  // namespace server
