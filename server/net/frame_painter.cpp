#include "server/net/frame_painter.h"

#include <algorithm>
#include <utility>

namespace server {

FramePainter::FramePainter(const base::ViewCamera& view, const base::Scene& scene, const SceneRenderer& renderer)
    : camera_(base::cameraForScene(view, scene.origin, {renderer.sceneCenter(), renderer.sceneRadius()})),
      options_(exactFrameOptions(view.width, view.height)) {
  const std::uint64_t rows = kBandPixels / static_cast<std::uint64_t>(std::max(1, view.width));
  band_height_ = static_cast<int>(std::clamp<std::uint64_t>(rows, 1, static_cast<std::uint64_t>(view.height)));
}

base::Result<bool> FramePainter::drawNextBand(SceneRenderer& renderer) {
  if (next_row_ == 0) {
    LUMIGRID_ASSIGN_OR_RETURN(chosen_, renderer.selectPatches(camera_, options_));
  }
  const int height = std::min(band_height_, camera_.height - next_row_);
  const bool is_whole = height == camera_.height;
  const base::Camera camera = is_whole ? camera_ : tileCamera(camera_, 0, next_row_, camera_.width, height);
  LUMIGRID_ASSIGN_OR_RETURN(auto band, renderer.renderPatches(camera, chosen_, options_));
  if (is_whole) {
    picture_ = std::move(band.rgba);
  } else {
    if (picture_.pixels.empty()) picture_ = base::Image(camera_.width, camera_.height, band.rgba.channels);
    std::copy(band.rgba.pixels.begin(), band.rgba.pixels.end(), picture_.at(0, next_row_));
  }
  next_row_ += height;
  return next_row_ == camera_.height;
}

}  // namespace server
