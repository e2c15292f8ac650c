#pragma once
// Draws one exact frame in steps that are short enough for other viewers' frames to come between.
#include <cstdint>
#include <memory>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "server/render/scene_renderer.h"

namespace server {

class FramePainter {
 public:
  /// About how many pixels a step draws: a frame of a usual window is drawn at once, since each step costs a little
  /// more.
  static constexpr std::uint64_t kBandPixels = 2'200'000;

  FramePainter(const base::ViewCamera& view, const base::Scene& scene, const SceneRenderer& renderer);
  /// Draws the next band, from the top. True: that was the last one.
  base::Result<bool> drawNextBand(SceneRenderer& renderer);
  /// Moves the picture out (as RenderedPicture::rgba), once, after the last band.
  base::Image takePicture() { return std::move(picture_); }

 private:
  base::Camera camera_;
  RenderOptions options_;
  int band_height_;
  int next_row_ = 0;
  lod::patch::Cut chosen_;
  base::Image picture_;
};

}  // namespace server
