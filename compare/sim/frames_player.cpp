// Remote rendering by pictures, as trame and ParaViewWeb do it: the client sends its camera, the server draws and
// encodes the newest one as soon as the last picture has left, and the client shows what arrived last.
#include <algorithm>
#include <deque>
#include <utility>

#include "compare/sim/player.h"
#include "compare/sim/remote_picture.h"
#include "repository/faces/jpeg.h"

namespace compare {
namespace {

constexpr std::size_t kCameraMessageBytes = 96;  // position, direction, up, angle and size

class FramesPlayer final : public Player {
 public:
  FramesPlayer(const Stage& stage, int quality, const LinkProfile& link)
      : stage_(stage),
        quality_(quality),
        down_(std::make_shared<Wire>(link), stage.seed),
        up_(std::make_shared<Wire>(link), stage.seed + 1),
        connected_at_(kHandshakeRoundTrips * link.round_trip_seconds) {}

  base::Result<void> advance(double now, const base::ViewCamera& camera) override;
  base::Result<base::Image> draw() override;
  bool atRest() const override { return shown_text_ == textOf(camera_); }
  PlayerCounts counts() const override;

 private:
  /// A view on its way through server and link.
  struct View {
    base::ViewCamera camera;
    double seen = 0.0;  ///< when the client looked at it
    base::Bytes mask;   ///< of the drawn picture
  };
  struct Arrival {
    View view;
    base::Image picture;
    double shown = 0.0;  ///< when it is decoded
  };

  double nextEvent() const;
  base::Result<void> act(double now);
  base::Result<void> render(double now);
  base::Result<void> receive(double now);

  const Stage& stage_;
  const int quality_;
  Pipe down_, up_;
  const double connected_at_;
  double now_ = 0.0;
  base::ViewCamera camera_;
  std::string sent_text_;       // the view that the client told last
  std::deque<View> told_;       // on their way to the server
  std::optional<View> newest_;  // at the server, not drawn yet
  std::optional<View> drawing_;
  double drawn_at_ = 0.0;
  std::deque<View> coming_;  // on their way to the client
  std::deque<Arrival> decoding_;
  double decoder_free_ = 0.0;
  std::optional<Arrival> shown_;
  std::string shown_text_;
  std::uint64_t sent_messages_ = 0;
};

double FramesPlayer::nextEvent() const {
  const double drawn = drawing_ ? drawn_at_ : kNever;
  return std::min({drawn, down_.nextEvent(), up_.nextEvent()});
}

base::Result<void> FramesPlayer::render(double now) {
  if (drawing_ && now >= drawn_at_) {
    const auto jpegOf = [this](const base::Image& rgb) {
      return repository::encodeJpeg(rgb, quality_, repository::Subsampling::k420);
    };
    const std::string form = "frame " + std::to_string(quality_);
    LUMIGRID_ASSIGN_OR_RETURN(auto frame, remotePicture(*stage_.painter, drawing_->camera, form, jpegOf));
    coming_.push_back(*std::exchange(drawing_, std::nullopt));
    coming_.back().mask = std::move(frame.mask);
    down_.send(std::move(frame.coded), now);
  }
  if (drawing_ || !newest_ || down_.unsentBytes() > 0) return {};
  drawing_ = std::exchange(newest_, std::nullopt);
  drawn_at_ = now + stage_.costs.server_render_seconds;
  return {};
}

base::Result<void> FramesPlayer::receive(double now) {
  for (; up_.take(now); told_.pop_front()) newest_ = told_.front();
  while (const auto frame = down_.take(now)) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto rgb, repository::decodeJpeg(*frame));
    const double pixels = static_cast<double>(rgb.width) * rgb.height;
    decoder_free_ = std::max(decoder_free_, now) + stage_.costs.client_decode_seconds * pixels / (512.0 * 512.0);
    base::Image picture = withCoverage(rgb, coming_.front().mask);
    decoding_.push_back({std::move(coming_.front()), std::move(picture), decoder_free_});
    coming_.pop_front();
  }
  return {};
}

base::Result<void> FramesPlayer::act(double now) {
  down_.advance(now);
  up_.advance(now);
  LUMIGRID_TRY(receive(now));
  return render(now);
}

base::Result<void> FramesPlayer::advance(double now, const base::ViewCamera& camera) {
  for (double next = nextEvent(); next <= now; next = nextEvent()) LUMIGRID_TRY(act(std::max(next, now_)));
  now_ = now;
  camera_ = camera;
  if (const std::string text = textOf(camera); now >= connected_at_ && text != sent_text_) {
    sent_text_ = text;
    told_.push_back({camera, now, {}});
    up_.send(base::Bytes(kCameraMessageBytes), now);
    ++sent_messages_;
  }
  LUMIGRID_TRY(act(now));
  for (; !decoding_.empty() && decoding_.front().shown <= now; decoding_.pop_front()) {
    shown_ = std::move(decoding_.front());
    shown_text_ = textOf(shown_->view.camera);
  }
  return {};
}

base::Result<base::Image> FramesPlayer::draw() {
  if (shown_) return shown_->picture;
  return base::Image(camera_.width, camera_.height, 4);
}

PlayerCounts FramesPlayer::counts() const {
  PlayerCounts counts;
  counts.bytes = counts.bytes_frames = down_.deliveredBytes();
  counts.requests = sent_messages_;
  if (shown_) counts.age_seconds = now_ - shown_->view.seen;
  return counts;
}

}  // namespace

base::Result<std::unique_ptr<Player>> makeFramesPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link) {
  return std::unique_ptr<Player>(std::make_unique<FramesPlayer>(stage, static_cast<int>(setting.knob), link));
}

}  // namespace compare
