#include "compare/sim/remote_player.h"

namespace compare {
namespace {

constexpr std::size_t kCameraMessageBytes = 96;  // position, direction, up, angle and size

}  // namespace

RemotePlayer::RemotePlayer(const Stage& stage, const LinkProfile& link)
    : stage_(stage),
      down_(std::make_shared<Wire>(link), stage.seed),
      up_(std::make_shared<Wire>(link), stage.seed + 1),
      connected_at_(kHandshakeRoundTrips * link.round_trip_seconds) {}

base::Result<void> RemotePlayer::advance(double now, const base::ViewCamera& camera) {
  for (double next = nextEvent(); next <= now; next = nextEvent()) LUMIGRID_TRY(act(std::max(next, now_)));
  now_ = now;
  camera_ = camera;
  text_ = textOf(camera);
  if (now >= connected_at_ && text_ != sent_text_) {
    sent_text_ = text_;
    told_.push_back({camera, text_, now, {}, true});
    up_.send(base::Bytes(kCameraMessageBytes), now);
    ++sent_messages_;
  }
  LUMIGRID_TRY(act(now));
  for (; !decoding_.empty() && decoding_.front().shown <= now; decoding_.pop_front())
    shown_ = std::move(decoding_.front());
  return {};
}

double RemotePlayer::nextEvent() const {
  const double drawn = drawing_ ? drawn_at_ : kNever;
  return std::min({drawn, nextServe(), down_.nextEvent(), up_.nextEvent()});
}

base::Result<void> RemotePlayer::act(double now) {
  down_.advance(now);
  up_.advance(now);
  LUMIGRID_TRY(receive(now));
  LUMIGRID_TRY(finishDrawing(now));
  serve(now);
  return {};
}

base::Result<void> RemotePlayer::receive(double now) {
  for (; up_.take(now); told_.pop_front()) acceptView(std::move(told_.front()));
  while (const auto coded = down_.take(now)) {
    LUMIGRID_ASSIGN_OR_RETURN(auto picture, decode(*coded));
    const double pixels = static_cast<double>(picture.width) * picture.height;
    decoder_free_ = std::max(decoder_free_, now) + stage_.costs.client_decode_seconds * pixels / (512.0 * 512.0);
    decoding_.push_back({std::move(coming_.front()), std::move(picture), decoder_free_});
    coming_.pop_front();
  }
  return {};
}

void RemotePlayer::beginToDraw(View view, double now) {
  drawing_ = std::move(view);
  drawn_at_ = now + stage_.costs.server_render_seconds;
}

base::Result<void> RemotePlayer::finishDrawing(double now) {
  if (!drawing_ || now < drawn_at_) return {};
  LUMIGRID_ASSIGN_OR_RETURN(auto picture, encode(drawing_->camera));
  coming_.push_back(*std::exchange(drawing_, std::nullopt));
  coming_.back().coverage = std::move(picture.coverage);
  down_.send(std::move(picture.coded), now);
  return {};
}

base::Result<base::Image> RemotePlayer::draw() {
  if (!shown_) return base::Image(camera_.width, camera_.height, 4);
  return withCoverage(shown_->picture, shown_->view.coverage);
}

PlayerCounts RemotePlayer::counts() const {
  PlayerCounts counts;
  counts.bytes = counts.bytes_frames = down_.deliveredBytes();
  counts.requests = sent_messages_;
  if (shown_) counts.age_seconds = now_ - shown_->view.seen;
  return counts;
}

}  // namespace compare
