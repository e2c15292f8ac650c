#pragma once
// The viewer of a client that draws by itself, in virtual time: with its decoder, its screen and the view that it has.
#include <memory>
#include <utility>

#include "base/gl/gl.h"
#include "client/viewer/viewer.h"
#include "compare/sim/player.h"
#include "compare/sim/virtual_decoder.h"

namespace compare {

class ViewerClient {
 public:
  ViewerClient(const client::ViewerOptions& options, const Costs& costs)
      : ViewerClient(options, std::make_unique<VirtualDecoder>(costs.client_decode_seconds)) {}

  client::Viewer& viewer() { return viewer_; }
  /// Takes in what has arrived by `now`, seconds, for this view.
  base::Result<void> update(const base::ViewCamera& camera, double now) {
    camera_ = camera;
    now_ = now;
    decoder_->setTime(now);
    LUMIGRID_ASSIGN_OR_RETURN(more_, viewer_.update(camera, now));
    return {};
  }
  /// Player::draw() of the newest view.
  base::Result<base::Image> draw() {
    if (target_.width() != camera_.width || target_.height() != camera_.height) {
      LUMIGRID_ASSIGN_OR_RETURN(target_, base::gl::RenderTarget::create(camera_.width, camera_.height));
    }
    target_.bind();
    LUMIGRID_TRY(viewer_.draw(camera_, now_));
    return client::readPicture(target_, viewer_);
  }
  base::Result<void> drawUnseen() { return viewer_.drawUnseen(camera_, now_); }
  bool atRest() const { return viewer_.allHere() && !more_; }
  /// All counts but bytes and requests of the link.
  PlayerCounts counts() const {
    const client::ViewerStats stats = viewer_.stats();
    PlayerCounts counts;
    counts.bytes_images = stats.session.bytes_faces;
    counts.bytes_patches = stats.session.bytes_patches;
    counts.bytes_frames = stats.session.bytes_frames;
    counts.cache_bytes = stats.session.cache_bytes;
    counts.triangles = stats.lumigraph.triangles;
    counts.images = stats.lumigraph.samples_used;
    return counts;
  }

 private:
  ViewerClient(const client::ViewerOptions& options, std::unique_ptr<VirtualDecoder> decoder)
      : decoder_(decoder.get()), viewer_(options, std::move(decoder)) {}

  VirtualDecoder* decoder_;  // the viewer's
  client::Viewer viewer_;
  base::gl::RenderTarget target_;
  base::ViewCamera camera_;
  double now_ = 0.0;
  bool more_ = true;
};

/// A viewer's defaults for displays of which few frames are drawn, with this tolerance of the patches under images, in
/// pixels.
inline client::ViewerOptions viewerOptions(double tolerance_px) {
  client::ViewerOptions options;
  options.lumigraph.depth_maps_per_frame *= kFramesPerDrawn;
  // As on a machine with graphics hardware, whatever draws here.
  options.fps = 0.0;
  options.session.patch_tolerance_px = static_cast<float>(tolerance_px);
  return options;
}

}  // namespace compare
