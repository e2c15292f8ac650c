// Remote rendering by video, as cloud gaming does it: the server draws the client's newest view at a fixed rate and
// encodes it as H.264 within a share of the link's rate.
#include <cmath>

#include "compare/sim/remote_player.h"
#include "compare/sim/video_codec.h"

namespace compare {
namespace {

constexpr int kVideoHertz = 30;            // a choice; drawing each picture is what costs here
constexpr double kMaxBitRate = 50e6;       // the most that services of cloud gaming send
constexpr int kStillFrames = kVideoHertz;  // a view at rest becomes sharper for so many pictures more
/// The server leaves pictures out while more waits than the link's share brings in so many seconds.
constexpr double kMaxQueueSeconds = 0.1;

class VideoPlayer final : public RemotePlayer {
 public:
  VideoPlayer(const Stage& stage, double bits_per_second, const LinkProfile& link)
      : RemotePlayer(stage, link), bits_per_second_(bits_per_second) {}

 private:
  void acceptView(View view) override {
    newest_ = std::move(view);
    still_ = 0;
  }
  double tickTime() const { return static_cast<double>(tick_) / kVideoHertz; }
  bool streams() const { return newest_ && still_ < kStillFrames; }
  double nextServe() const override { return streams() ? tickTime() : kNever; }
  void serve(double now) override;
  base::Result<RemotePicture> encode(const base::ViewCamera& camera) override;
  base::Result<base::Image> decode(base::ByteView coded) override { return decoder_->decode(coded); }

  const double bits_per_second_;
  std::optional<View> newest_;
  int still_ = 0;          // pictures of it that were begun
  std::int64_t tick_ = 0;  // the next picture's place in time
  std::unique_ptr<VideoEncoder> encoder_;
  std::unique_ptr<VideoDecoder> decoder_;
};

void VideoPlayer::serve(double now) {
  if (now < tickTime()) return;
  tick_ = static_cast<std::int64_t>(std::floor(now * kVideoHertz + 1e-6)) + 1;
  const double most_waiting = kMaxQueueSeconds * bits_per_second_ / 8.0;
  if (!streams() || draws() || static_cast<double>(unsentBytes()) > most_waiting) return;
  newest_->last = ++still_ == kStillFrames;
  beginToDraw(*newest_, now);
}

base::Result<RemotePicture> VideoPlayer::encode(const base::ViewCamera& camera) {
  if (!encoder_) {
    const VideoFormat format{camera.width, camera.height, kVideoHertz, bits_per_second_};
    LUMIGRID_ASSIGN_OR_RETURN(encoder_, VideoEncoder::create(format));
    LUMIGRID_ASSIGN_OR_RETURN(decoder_, VideoDecoder::create(camera.width, camera.height));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto picture, remotePicture(*stage().painter, camera, toVideoInput));
  LUMIGRID_ASSIGN_OR_RETURN(picture.coded, encoder_->encode(picture.coded));
  return picture;
}

}  // namespace

base::Result<std::unique_ptr<Player>> makeVideoPlayer(const Stage& stage, const MethodSetting& setting,
                                                      const LinkProfile& link) {
  const double rate = std::min(kMaxBitRate, 0.01 * setting.knob * 8.0 * link.bytes_per_second);
  return std::unique_ptr<Player>(std::make_unique<VideoPlayer>(stage, rate, link));
}

}  // namespace compare
