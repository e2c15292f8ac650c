// The methods that a server's session feeds: the Grid-Lumigraph as it is by default (for a scene without images,
// patches and exact frames), with the paper's settings, and patches alone. Server and client are the programs' own; the
// link between them is simulated.
#include <algorithm>
#include <utility>

#include "compare/sim/viewer_client.h"
#include "server/net/server.h"
#include "server/session/session.h"

namespace compare {
namespace {

class SessionPlayer final : public Player {
 public:
  SessionPlayer(const Stage& stage, const server::SceneData& data, const client::ViewerOptions& viewer,
                const LinkProfile& link)
      : stage_(stage),
        data_(data),
        server_(data_),
        down_(std::make_shared<Wire>(link), stage.seed),
        up_(std::make_shared<Wire>(link), stage.seed + 1),
        client_(viewer, stage.costs),
        connected_at_(kHandshakeRoundTrips * link.round_trip_seconds) {}

  base::Result<void> advance(double now, const base::ViewCamera& camera) override;
  base::Result<base::Image> draw() override { return client_.draw(); }
  base::Result<void> drawUnseen() override { return client_.drawUnseen(); }
  bool atRest() const override { return client_.atRest(); }
  PlayerCounts counts() const override;

 private:
  struct Rendering {
    server::FrameRequest request;
    double ready = 0.0;
  };

  double nextEvent() const;
  base::Result<void> act(double now);
  void tellLink(double now);
  void requestFrame(double now);
  base::Result<void> finishRendering(double now);
  void serve(double now);
  base::Result<void> deliver(double now);
  void sendFromClient(double now);
  client::Session& session() { return client_.viewer().session(); }

  const Stage& stage_;
  server::SceneData data_;
  server::Session server_;
  Pipe down_, up_;
  ViewerClient client_;
  const double connected_at_;
  double now_ = 0.0;
  double view_height_ = 1.0;  // pixels
  bool connected_ = false;
  std::optional<Rendering> rendering_;
  std::optional<server::FrameRequest> queued_;  // rendered next; a newer request replaces it
  std::uint64_t sent_messages_ = 0;
};

double SessionPlayer::nextEvent() const {
  double next = connected_ ? kNever : connected_at_;
  if (rendering_) next = std::min(next, rendering_->ready);
  if (const auto wake = server_.wakeAt()) next = std::min(next, std::max(*wake, now_));
  return std::min({next, down_.nextEvent(), up_.nextEvent()});
}

void SessionPlayer::tellLink(double now) {
  server_.setLink({now, down_.unsentBytes(), down_.unconfirmedBytes(), down_.roundTripSeconds()});
}

/// The renderer draws one frame at a time, as server::FrameRenderer does, and takes longer for more pixels than the
/// view has.
void SessionPlayer::requestFrame(double now) {
  if (const auto request = server_.nextFrameRequest()) queued_ = request;
  if (rendering_ || !queued_) return;
  const double scale = queued_->camera.height / view_height_;
  rendering_ = {*std::exchange(queued_, std::nullopt), now + scale * scale * stage_.costs.server_render_seconds};
}

/// Writes while few bytes wait, as server::WebSocketSession does.
void SessionPlayer::serve(double now) {
  tellLink(now);
  requestFrame(now);
  while (down_.unsentBytes() < server::ServerOptions().max_unsent_bytes) {
    auto message = server_.nextMessage();
    if (!message) break;
    down_.send(message->bytes(), now);
    tellLink(now);
  }
  requestFrame(now);
}

base::Result<void> SessionPlayer::finishRendering(double now) {
  if (!rendering_ || now < rendering_->ready) return {};
  const Rendering done = *std::exchange(rendering_, std::nullopt);
  LUMIGRID_ASSIGN_OR_RETURN(auto frame, stage_.painter->exactFrame(done.request));
  server_.frameRendered(done.request, std::move(frame));
  return {};
}

base::Result<void> SessionPlayer::deliver(double now) {
  while (auto message = down_.take(now)) LUMIGRID_TRY(session().receive(*message));
  while (auto message = up_.take(now)) LUMIGRID_TRY(server_.receive(*message));
  return {};
}

void SessionPlayer::sendFromClient(double now) {
  if (!connected_) return;
  for (; auto message = session().nextToSend(); ++sent_messages_) up_.send(std::move(*message), now);
}

base::Result<void> SessionPlayer::act(double now) {
  if (!connected_ && now >= connected_at_) {
    connected_ = true;
    session().connected();
  }
  down_.advance(now);
  up_.advance(now);
  tellLink(now);
  LUMIGRID_TRY(deliver(now));
  LUMIGRID_TRY(finishRendering(now));
  sendFromClient(now);
  serve(now);
  return {};
}

base::Result<void> SessionPlayer::advance(double now, const base::ViewCamera& camera) {
  view_height_ = camera.height;
  for (double next = nextEvent(); next <= now; next = nextEvent()) LUMIGRID_TRY(act(std::max(next, now_)));
  now_ = now;
  LUMIGRID_TRY(client_.update(camera, now));
  return act(now);
}

PlayerCounts SessionPlayer::counts() const {
  PlayerCounts counts = client_.counts();
  counts.bytes = down_.deliveredBytes();
  counts.requests = sent_messages_;
  return counts;
}

}  // namespace

base::Result<std::unique_ptr<Player>> makeSessionPlayer(const Stage& stage, const MethodSetting& setting,
                                                        const LinkProfile& link) {
  server::SceneData data = stage.scene->data;
  data.access = nullptr;
  data.images_are_remote = false;  // the session reads them itself, which takes no virtual time
  data.welcome.can_render_frames = true;
  client::ViewerOptions viewer = viewerOptions(setting.knob);
  if (setting.method == "patches") {
    viewer.method = client::Method::kPatches;
    viewer.session.alone_tolerance_px = static_cast<float>(setting.knob);
  }
  if (setting.method == "paper") {
    // Okamoto 2011, section 6: the eight nearest points, whatever hides what, a cache of 50 MB, no exact frames, and
    // nothing after the images.
    data.sight = nullptr;
    viewer.session.refine = false;
    data.welcome.can_render_frames = false;
    viewer.session.cache_bytes = 50'000'000;
    viewer.session.max_points = 8;
  }
  return std::unique_ptr<Player>(std::make_unique<SessionPlayer>(stage, data, viewer, link));
}

}  // namespace compare
