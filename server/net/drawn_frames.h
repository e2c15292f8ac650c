#pragma once
// Pictures that exact frames were encoded from. A view that stands gets a quick frame and then a better one of the same
// picture, and everybody who opens a scene looks at the same first view: each is drawn once.
#include <cstddef>
#include <list>

#include "base/camera.h"
#include "base/image.h"

namespace server {

/// Keeps the newest pictures. Not for several threads.
class DrawnFrames {
 public:
  /// `max_bytes`: of all pixels; a larger picture is not kept.
  explicit DrawnFrames(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  /// Returns the scene's picture for this very camera, null where none is kept; valid until the next call of another
  /// function.
  const base::Image* find(std::size_t scene, const base::ViewCamera& camera);
  /// Keeps a picture that find() does not have; those that were not asked for longest go.
  void add(std::size_t scene, const base::ViewCamera& camera, base::Image picture);
  /// Forgets the scene's pictures, as when its light changes.
  void forget(std::size_t scene);
  std::size_t bytes() const { return bytes_; }

 private:
  struct Drawn {
    std::size_t scene;
    base::ViewCamera camera;
    base::Image picture;
  };

  std::list<Drawn> pictures_;  // the last one asked for first
  std::size_t bytes_ = 0;
  const std::size_t max_bytes_;
};

}  // namespace server
