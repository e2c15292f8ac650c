#pragma once
// A client of a host of files in virtual time, whatever it reads from there.
#include <algorithm>

#include "compare/sim/fetcher.h"
#include "compare/sim/viewer_client.h"

namespace compare {

class HostPlayer : public Player {
 public:
  base::Result<void> advance(double now, const base::ViewCamera& camera) override {
    for (double next = nextEvent(); next <= now; next = nextEvent()) pump(std::max(next, now_));
    pump(now);
    LUMIGRID_TRY(client_.update(camera, now));
    pump(now);
    return {};
  }
  base::Result<base::Image> draw() override { return client_.draw(); }
  base::Result<void> drawUnseen() override { return client_.drawUnseen(); }
  bool atRest() const override { return client_.atRest(); }
  PlayerCounts counts() const override {
    PlayerCounts counts = client_.counts();
    counts.bytes = fetcher_.deliveredBytes();
    counts.requests = fetcher_.requests();
    return counts;
  }

 protected:
  /// `fetcher` outlives it.
  HostPlayer(SimulatedFetcher& fetcher, const client::ViewerOptions& options, const Stage& stage,
             const LinkProfile& link)
      : fetcher_(fetcher), client_(options, stage.costs), begins_at_(kRoundTripsBefore * link.round_trip_seconds) {}
  /// Hands the viewer's session what the fetcher has read by `now`, and requests more.
  virtual void pumpSource(double now) = 0;
  client::Viewer& viewer() { return client_.viewer(); }

 private:
  // scene.json, which names the objects. TCP's handshake is that of the fetcher's connections.
  static constexpr double kRoundTripsBefore = 1.0;

  double nextEvent() const { return now_ < begins_at_ ? begins_at_ : fetcher_.nextEvent(); }
  void pump(double now) {
    now_ = now;
    if (now < begins_at_) return;
    fetcher_.advance(now);
    pumpSource(now);
  }

  SimulatedFetcher& fetcher_;
  ViewerClient client_;
  const double begins_at_;
  double now_ = 0.0;
};

}  // namespace compare
