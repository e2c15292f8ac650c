#pragma once
// Reads pixels back from the GPU without waiting for each picture: a ring of pixel buffers with fences.
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "base/error.h"
#include "base/gl/gl.h"
#include "base/image.h"
#include "server/render/tiling.h"

namespace server {

struct RenderedPicture {
  base::Image rgba;             ///< alpha: 255 where all samples of the pixel saw the model, 0 where none did
  std::uint64_t triangles = 0;  ///< drawn
};

/// A picture that is being read back in one or more tiles.
struct PendingPicture {
  RenderedPicture rendered;  ///< transparent black where tiles have not arrived
  std::size_t tiles_left = 0;
  std::function<void(RenderedPicture)> deliver;  ///< called once all tiles are there
};

/// Delivers pictures in the order in which their reading began.
class ReadbackQueue {
 public:
  /// `depth`: tiles in flight before read() waits for the oldest.
  explicit ReadbackQueue(std::size_t depth) : depth_(depth) {}
  ~ReadbackQueue();
  ReadbackQueue(const ReadbackQueue&) = delete;
  ReadbackQueue& operator=(const ReadbackQueue&) = delete;

  /// Starts to read a tile of the picture from `framebuffer`; its lowest left pixel there is (left, bottom), GL's way
  /// up. May deliver older pictures.
  base::Result<void> read(const std::shared_ptr<PendingPicture>& picture, const Tile& tile, GLuint framebuffer,
                          int left, int bottom);
  /// Adds a tile that shows nothing: it keeps its place in the order and costs no transfer.
  base::Result<void> skip(const std::shared_ptr<PendingPicture>& picture);
  /// Waits for all pictures and delivers them.
  base::Result<void> finish();
  /// Drops all pictures that were not delivered.
  void drop();

 private:
  struct Entry {
    std::shared_ptr<PendingPicture> picture;
    Tile tile;
    base::gl::Buffer pixels;  ///< no name: the tile was skipped
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
