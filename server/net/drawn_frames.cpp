#include "server/net/drawn_frames.h"

#include <algorithm>
#include <utility>

namespace server {

DrawnFrames::Picture DrawnFrames::find(const void* scene, const base::ViewCamera& camera) {
  const auto found = std::find_if(pictures_.begin(), pictures_.end(),
                                  [&](const Drawn& drawn) { return drawn.scene == scene && drawn.camera == camera; });
  if (found == pictures_.end()) return nullptr;
  pictures_.splice(pictures_.begin(), pictures_, found);
  return pictures_.front().picture;
}

void DrawnFrames::add(const void* scene, const base::ViewCamera& camera, Picture picture) {
  bytes_ += picture->pixels.size();
  pictures_.push_front({scene, camera, std::move(picture)});
  for (; bytes_ > max_bytes_; pictures_.pop_back()) bytes_ -= pictures_.back().picture->pixels.size();
}

void DrawnFrames::forget(const void* scene) {
  std::erase_if(pictures_, [&](const Drawn& drawn) {
    if (drawn.scene == scene) bytes_ -= drawn.picture->pixels.size();
    return drawn.scene == scene;
  });
}

}  // namespace server
