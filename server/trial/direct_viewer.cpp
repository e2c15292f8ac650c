#include "server/trial/direct_viewer.h"

#include <memory>
#include <utility>
#include <vector>

#include "base/gl/gl.h"
#include "repository/faces/face_image.h"

namespace server {
namespace {

constexpr int kMaxRounds = 10'000;  // of messages for a view; a hundred are many
constexpr double kRoundSeconds = 1.0 / 60.0;

/// Decodes at once.
class ImmediateDecoder final : public client::ImageDecoder {
 public:
  void submit(std::uint64_t id, base::ByteView coded) override {
    auto image = repository::decodeFaceImage(coded, 0);  // 0: any size
    done_.push_back(image ? DecodedImage{id, std::move(*image), {}} : DecodedImage{id, {}, image.error().message});
  }
  std::vector<DecodedImage> takeDecoded() override { return std::exchange(done_, {}); }
  std::size_t pending() const override { return done_.size(); }

 private:
  std::vector<DecodedImage> done_;
};

}  // namespace

client::ViewerOptions settledOptions(client::Method method) {
  client::ViewerOptions options;
  options.method = method;
  options.session.images = options.lumigraph.use_images = method == client::Method::kLumigraph;
  options.session.frames = false;
  options.session.refine = false;  // its patches are those of a moving view
  options.lumigraph.fade_seconds = 0.0F;
  options.lumigraph.depth_maps_per_frame = options.lumigraph.max_samples;
  options.upload_milliseconds = 0.0;
  // Each picture is a last one.
  options.effort = client::DrawEffort{.pictures = client::PictureMean::kMostPictures};
  return options;
}

DirectViewer::DirectViewer(const SceneData& data, const client::ViewerOptions& options)
    : server_(data), viewer_(options, std::make_unique<ImmediateDecoder>()) {
  viewer_.session().connected();
}

base::Result<base::Image> DirectViewer::show(const base::ViewCamera& camera) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto target, base::gl::RenderTarget::create(camera.width, camera.height));
  for (int round = 0; round < kMaxRounds; ++round) {
    now_ += kRoundSeconds;
    LUMIGRID_TRY(exchangeMessages());
    LUMIGRID_ASSIGN_OR_RETURN(const bool more, viewer_.update(camera, now_));
    if (more || !viewer_.allHere()) continue;
    target.bind();
    LUMIGRID_TRY(viewer_.draw(camera, now_));
    if (viewer_.stats().complete) return client::readPicture(target, viewer_);
  }
  return base::Error{base::ErrorCode::kUnsupported, "a view of the trial never became complete; say what to build"};
}

base::Result<void> DirectViewer::redraw(const base::ViewCamera& camera) {
  now_ += kRoundSeconds;
  return viewer_.draw(camera, now_);
}

base::Result<void> DirectViewer::exchangeMessages() {
  client::Session& session = viewer_.session();
  while (const auto message = session.nextToSend()) LUMIGRID_TRY(server_.receive(*message));
  while (const auto message = server_.nextMessage()) LUMIGRID_TRY(session.receive(*message));
  return {};
}

}  // namespace server
