#pragma once
// A client of a host of files in virtual time, whatever it reads from there.
#include <algorithm>
#include <memory>
#include <utility>

#include "client/viewer/viewer.h"
#include "compare/sim/fetcher.h"
#include "compare/sim/player.h"
#include "compare/sim/viewer_screen.h"
#include "compare/sim/virtual_decoder.h"

namespace compare {

class HostPlayer : public Player {
 public:
  base::Result<void> advance(double now, const base::ViewCamera& camera) override {
    for (double next = nextEvent(); next <= now; next = nextEvent()) pump(std::max(next, now_));
    camera_ = camera;
    pump(now);
    decoder_->setTime(now);
    LUMIGRID_ASSIGN_OR_RETURN(more_, viewer_.update(camera, now));
    pump(now);
    return {};
  }
  base::Result<base::Image> draw() override { return screen_.show(viewer_, camera_, now_); }
  base::Result<void> drawUnseen() override { return viewer_.drawUnseen(camera_, now_); }
  bool atRest() const override { return viewer_.allHere() && !more_; }
  PlayerCounts counts() const override {
    const client::ViewerStats stats = viewer_.stats();
    PlayerCounts counts;
    counts.bytes = fetcher_.deliveredBytes();
    counts.bytes_images = stats.session.bytes_faces;
    counts.bytes_patches = stats.session.bytes_patches;
    counts.requests = fetcher_.requests();
    counts.cache_bytes = stats.session.cache_bytes;
    counts.triangles = stats.lumigraph.triangles;
    counts.images = stats.lumigraph.samples_used;
    return counts;
  }

 protected:
  /// `fetcher` outlives it.
  HostPlayer(SimulatedFetcher& fetcher, const client::ViewerOptions& options, const Stage& stage,
             const LinkProfile& link)
      : HostPlayer(fetcher, options, link, std::make_unique<VirtualDecoder>(stage.costs.client_decode_seconds)) {}
  /// Hands the viewer's session what the fetcher has read by `now`, and requests more.
  virtual void pumpSource(double now) = 0;
  client::Viewer& viewer() { return viewer_; }
  const SimulatedFetcher& fetcher() const { return fetcher_; }

 private:
  // scene.json, which names the objects. TCP's handshake is that of the fetcher's connections.
  static constexpr double kRoundTripsBefore = 1.0;

  HostPlayer(SimulatedFetcher& fetcher, const client::ViewerOptions& options, const LinkProfile& link,
             std::unique_ptr<VirtualDecoder> decoder)
      : fetcher_(fetcher),
        decoder_(decoder.get()),
        viewer_(options, std::move(decoder)),
        begins_at_(kRoundTripsBefore * link.round_trip_seconds) {}

  double nextEvent() const { return now_ < begins_at_ ? begins_at_ : fetcher_.nextEvent(); }
  void pump(double now) {
    now_ = now;
    if (now < begins_at_) return;
    fetcher_.advance(now);
    pumpSource(now);
  }

  SimulatedFetcher& fetcher_;
  VirtualDecoder* decoder_;  // the viewer's
  client::Viewer viewer_;
  ViewerScreen screen_;
  base::ViewCamera camera_;
  double begins_at_;
  double now_ = 0.0;
  bool more_ = true;
};

}  // namespace compare
