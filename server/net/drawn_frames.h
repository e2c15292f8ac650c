#pragma once
// Pictures that exact frames were encoded from. A view that stands gets a quick frame and then a better one of the same
// picture, and everybody who opens a scene looks at the same first view: each is drawn once.
#include <cstddef>
#include <list>
#include <memory>

#include "base/camera.h"
#include "base/image.h"

namespace server {

/// Keeps the newest pictures. Not for several threads.
class DrawnFrames {
 public:
  using Picture = std::shared_ptr<const base::Image>;

  /// `max_bytes`: of all pixels; a larger picture is not kept.
  explicit DrawnFrames(std::size_t max_bytes) : max_bytes_(max_bytes) {}

  // `scene` tells scenes apart, and is not looked into.

  /// Returns the scene's picture for this very camera, null where none is kept.
  Picture find(const void* scene, const base::ViewCamera& camera);
  /// Keeps a picture that find() does not have; those that were not asked for longest go.
  void add(const void* scene, const base::ViewCamera& camera, Picture picture);
  /// Forgets the scene's pictures, as when its light changes.
  void forget(const void* scene);
  std::size_t bytes() const { return bytes_; }

 private:
  struct Drawn {
    const void* scene;
    base::ViewCamera camera;
    Picture picture;
  };

  std::list<Drawn> pictures_;  // the last one asked for first
  std::size_t bytes_ = 0;
  const std::size_t max_bytes_;
};

}  // namespace server
