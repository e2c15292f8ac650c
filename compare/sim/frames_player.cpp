// Remote rendering by pictures, as trame and ParaViewWeb do it: the server draws and encodes the client's newest view
// as soon as the last picture has left.
#include "base/jpeg/jpeg.h"
#include "compare/sim/remote_player.h"

namespace compare {
namespace {

class FramesPlayer final : public RemotePlayer {
 public:
  FramesPlayer(const Stage& stage, int quality, const LinkProfile& link)
      : RemotePlayer(stage, link), quality_(quality) {}

 private:
  void acceptView(View view) override { newest_ = std::move(view); }
  void serve(double now) override {
    if (draws() || !newest_ || unsentBytes() > 0) return;
    beginToDraw(*std::exchange(newest_, std::nullopt), now);
  }
  base::Result<RemotePicture> encode(const base::ViewCamera& camera) override {
    const auto jpegOf = [this](const base::Image& rgb) {
      return base::encodeJpeg(rgb, quality_, base::Subsampling::k420);
    };
    return remotePicture(*stage().painter, camera, jpegOf);
  }
  base::Result<base::Image> decode(base::ByteView coded) override { return base::decodeJpeg(coded); }

  const int quality_;
  std::optional<View> newest_;  // not drawn yet
};

}  // namespace

base::Result<std::unique_ptr<Player>> makeFramesPlayer(const Stage& stage, const MethodSetting& setting,
                                                       const LinkProfile& link) {
  return std::unique_ptr<Player>(std::make_unique<FramesPlayer>(stage, static_cast<int>(setting.knob), link));
}

}  // namespace compare
