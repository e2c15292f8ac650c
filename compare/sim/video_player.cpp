// Remote rendering by video, as cloud gaming does it: the server draws the newest view at a fixed rate and encodes it
// as H.264 within a share of the link's rate, and the client shows what arrived last.
#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

#include "compare/sim/player.h"
#include "compare/sim/remote_picture.h"
#include "compare/sim/video_codec.h"

namespace compare {
namespace {

constexpr std::size_t kCameraMessageBytes = 96;  // position, direction, up, angle and size
constexpr int kVideoHertz = 30;                  // a choice; drawing each picture is what costs here
constexpr double kMaxBitRate = 50e6;             // the most that services of cloud gaming send
constexpr int kStillFrames = kVideoHertz;        // a view at rest becomes sharper for so many pictures more
/// While more than this share of a second's bytes waits at the server, it leaves pictures out.
constexpr double kMaxQueueSeconds = 0.1;

class VideoPlayer final : public Player {
 public:
  VideoPlayer(const Stage& stage, double bits_per_second, const LinkProfile& link)
      : stage_(stage),
        bits_per_second_(bits_per_second),
        down_(std::make_shared<Wire>(link), stage.seed),
        up_(std::make_shared<Wire>(link), stage.seed + 1),
        connected_at_(kHandshakeRoundTrips * link.round_trip_seconds) {}

  base::Result<void> advance(double now, const base::ViewCamera& camera) override;
  base::Result<base::Image> draw() override;
  bool atRest() const override { return shown_ && shown_->view.last && shown_->view.text == textOf(camera_); }
  PlayerCounts counts() const override;

 private:
  /// A view on its way through server and link.
  struct View {
    base::ViewCamera camera;
    std::string text;
    double seen = 0.0;  ///< when the client looked at it
    base::Bytes mask;   ///< of the drawn picture
    bool last = false;  ///< the server sends no other while the view stays
  };
  struct Arrival {
    View view;
    base::Image picture;
    double shown = 0.0;  ///< when it is decoded
  };

  double tickTime() const { return static_cast<double>(tick_) / kVideoHertz; }
  bool streams() const { return newest_ && still_ < kStillFrames; }
  double nextEvent() const;
  base::Result<void> act(double now);
  base::Result<void> encode(double now);
  void begin(double now);
  base::Result<void> receive(double now);

  const Stage& stage_;
  const double bits_per_second_;
  Pipe down_, up_;
  const double connected_at_;
  double now_ = 0.0;
  base::ViewCamera camera_;
  std::string sent_text_;       // the view that the client told last
  std::deque<View> told_;       // on their way to the server
  std::optional<View> newest_;  // at the server
  int still_ = 0;               // pictures of it that were drawn
  std::int64_t tick_ = 0;       // the next picture's place in time
  std::optional<View> drawing_;
  double drawn_at_ = 0.0;
  std::unique_ptr<VideoEncoder> encoder_;
  std::unique_ptr<VideoDecoder> decoder_;
  std::deque<View> coming_;  // on their way to the client
  std::deque<Arrival> decoding_;
  double decoder_free_ = 0.0;
  std::optional<Arrival> shown_;
  std::uint64_t sent_messages_ = 0;
};

double VideoPlayer::nextEvent() const {
  const double drawn = drawing_ ? drawn_at_ : kNever;
  const double tick = streams() ? tickTime() : kNever;
  return std::min({drawn, tick, down_.nextEvent(), up_.nextEvent()});
}

/// Begins to draw the newest view, when it is time for a picture and the server is free.
void VideoPlayer::begin(double now) {
  if (now < tickTime()) return;
  tick_ = static_cast<std::int64_t>(std::floor(now * kVideoHertz + 1e-6)) + 1;
  const double most_waiting = kMaxQueueSeconds * bits_per_second_ / 8.0;
  if (!streams() || drawing_ || static_cast<double>(down_.unsentBytes()) > most_waiting) return;
  drawing_ = newest_;
  drawing_->last = ++still_ == kStillFrames;
  drawn_at_ = now + stage_.costs.server_render_seconds;
}

base::Result<void> VideoPlayer::encode(double now) {
  if (!drawing_ || now < drawn_at_) return {};
  View view = *std::exchange(drawing_, std::nullopt);
  const int width = view.camera.width, height = view.camera.height;
  if (!encoder_) {
    LUMIGRID_ASSIGN_OR_RETURN(encoder_, VideoEncoder::create({width, height, kVideoHertz, bits_per_second_}));
    LUMIGRID_ASSIGN_OR_RETURN(decoder_, VideoDecoder::create(width, height));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto picture, remotePicture(*stage_.painter, view.camera, "video", toVideoInput));
  LUMIGRID_ASSIGN_OR_RETURN(auto coded, encoder_->encode(picture.coded));
  view.mask = std::move(picture.mask);
  coming_.push_back(std::move(view));
  down_.send(std::move(coded), now);
  return {};
}

base::Result<void> VideoPlayer::receive(double now) {
  for (; up_.take(now); told_.pop_front()) {
    newest_ = told_.front();
    still_ = 0;
  }
  while (const auto coded = down_.take(now)) {
    LUMIGRID_ASSIGN_OR_RETURN(auto picture, decoder_->decode(*coded));
    const double pixels = static_cast<double>(picture.width) * picture.height;
    decoder_free_ = std::max(decoder_free_, now) + stage_.costs.client_decode_seconds * pixels / (512.0 * 512.0);
    decoding_.push_back({std::move(coming_.front()), std::move(picture), decoder_free_});
    coming_.pop_front();
  }
  return {};
}

base::Result<void> VideoPlayer::act(double now) {
  down_.advance(now);
  up_.advance(now);
  LUMIGRID_TRY(receive(now));
  LUMIGRID_TRY(encode(now));
  begin(now);
  return {};
}

base::Result<void> VideoPlayer::advance(double now, const base::ViewCamera& camera) {
  for (double next = nextEvent(); next <= now; next = nextEvent()) LUMIGRID_TRY(act(std::max(next, now_)));
  now_ = now;
  camera_ = camera;
  if (std::string text = textOf(camera); now >= connected_at_ && text != sent_text_) {
    sent_text_ = text;
    told_.push_back({camera, std::move(text), now, {}, false});
    up_.send(base::Bytes(kCameraMessageBytes), now);
    ++sent_messages_;
  }
  LUMIGRID_TRY(act(now));
  for (; !decoding_.empty() && decoding_.front().shown <= now; decoding_.pop_front())
    shown_ = std::move(decoding_.front());
  return {};
}

base::Result<base::Image> VideoPlayer::draw() {
  if (!shown_) return base::Image(camera_.width, camera_.height, 4);
  return withCoverage(shown_->picture, shown_->view.mask);
}

PlayerCounts VideoPlayer::counts() const {
  PlayerCounts counts;
  counts.bytes = counts.bytes_frames = down_.deliveredBytes();
  counts.requests = sent_messages_;
  if (shown_) counts.age_seconds = now_ - shown_->view.seen;
  return counts;
}

}  // namespace

base::Result<std::unique_ptr<Player>> makeVideoPlayer(const Stage& stage, const MethodSetting& setting,
                                                      const LinkProfile& link) {
  const double rate = std::min(kMaxBitRate, 0.01 * setting.knob * 8.0 * link.bytes_per_second);
  return std::unique_ptr<Player>(std::make_unique<VideoPlayer>(stage, rate, link));
}

}  // namespace compare
