#include "server/net/frame_renderer.h"

#include <utility>

#include "base/egl/headless.h"
#include "server/bake/frame_encoder.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr std::uint64_t kPatchBytes = std::uint64_t{2} << 30;  // GPU memory for the patches of all scenes together
constexpr std::size_t kDrawnBytes = std::size_t{64} << 20;     // eighteen pictures of 1280 x 720, two of 4K

}  // namespace

FrameRenderer::FrameRenderer(const std::vector<const OpenScene*>& scenes) : scenes_(scenes), drawn_(kDrawnBytes) {}

void FrameRenderer::runThread(const std::stop_token& stop, std::promise<base::Result<void>> started) {
  auto context = base::HeadlessContext::create();
  if (!context) return started.set_value(context.error());
  if (auto made = makeRenderers(); !made) {
    renderers_.clear();
    return started.set_value(made.error());
  }
  spdlog::info("frames: rendered by {}", (*context)->renderer());
  started.set_value({});
  std::optional<FrameJob> frame;
  while (waitForWork(stop, frame)) {
    takeUpLights();
    if (frame) frame->done(renderFrame(*frame));
    if (current_picture_) drawPictureBand();
  }
  current_picture_.reset();
  renderers_.clear();  // their GL objects go before the context does
}

/// The renderers share the GPU memory that one would take. Splats-only scenes have none.
base::Result<void> FrameRenderer::makeRenderers() {
  for (const OpenScene* scene : scenes_) {
    renderers_.emplace_back();
    if (scene->data.patches == nullptr) continue;
    LUMIGRID_ASSIGN_OR_RETURN(renderers_.back(),
                              SceneRenderer::create(scene->scene, scene->patches, kPatchBytes / scenes_.size()));
  }
  return {};
}

/// A picture that was begun is drawn to its end by the light it began with, and so are frames of its scene meanwhile.
void FrameRenderer::takeUpLights() {
  std::map<std::size_t, base::Light> lights;
  {
    const std::lock_guard lock(mutex_);
    for (auto it = lights_.begin(); it != lights_.end();) {
      const bool is_being_drawn = current_picture_ && current_picture_->painter && current_picture_->scene == it->first;
      const auto next = std::next(it);
      if (!is_being_drawn) lights.insert(lights_.extract(it));
      it = next;
    }
  }
  for (const auto& [scene, light] : lights) {
    drawn_.forget(scene);
    if (auto done = renderers_[scene]->setLight(light); !done) spdlog::warn("light: {}", done.error().message);
  }
}

/// Waits for a request. Sets `frame` to the next frame, if one waits, and keeps or begins the current picture. Returns
/// false when the renderer stops.
bool FrameRenderer::waitForWork(const std::stop_token& stop, std::optional<FrameJob>& frame) {
  std::unique_lock lock(mutex_);
  if (std::exchange(current_cancelled_, false)) {
    current_picture_.reset();
    current_client_.reset();
  }
  changed_.wait(lock, stop, [this] { return current_picture_ || !queue_.empty() || !pictures_.empty(); });
  if (stop.stop_requested()) return false;
  frame.reset();
  if (!queue_.empty()) {
    frame = std::move(queue_.front());
    queue_.pop_front();
  }
  if (!current_picture_ && !pictures_.empty()) {
    current_picture_ = std::move(pictures_.front());
    pictures_.pop_front();
    current_client_ = current_picture_->client;
  }
  return true;
}

void FrameRenderer::drawPictureBand() {
  const auto whole = drawNextBand(*current_picture_);
  if (whole && !*whole) return;
  if (!whole) spdlog::warn("picture: {}", whole.error().message);
  {
    const std::lock_guard lock(mutex_);
    current_client_.reset();
    if (std::exchange(current_cancelled_, false)) return current_picture_.reset();
  }
  if (whole)
    current_picture_->done(current_picture_->painter->takePicture());
  else
    current_picture_->done(whole.error());
  current_picture_.reset();
}

base::Result<bool> FrameRenderer::drawNextBand(PictureJob& job) const {
  SceneRenderer& renderer = *renderers_[job.scene];
  if (!job.painter) {
    LUMIGRID_ASSIGN_OR_RETURN(job.painter, PicturePainter::begin(job.request, scenes_[job.scene]->scene, renderer));
  }
  return job.painter->drawNextBand(renderer);
}

base::Bytes FrameRenderer::renderFrame(const FrameJob& job) {
  auto encoded = encodedFrame(job);
  if (!encoded) {
    spdlog::warn("frames: {}", encoded.error().message);
    return {};
  }
  return std::move(*encoded);
}

base::Result<base::Bytes> FrameRenderer::encodedFrame(const FrameJob& job) {
  const FrameRequest& request = job.request;
  if (const base::Image* drawn = drawn_.find(job.scene, request.camera))
    return encodeFrame(*drawn, request.codec, request.quality);
  const glm::dvec3& origin = scenes_[job.scene]->scene.origin;
  SceneRenderer& renderer = *renderers_[job.scene];
  const base::Sphere bounds{renderer.sceneCenter(), renderer.sceneRadius()};
  LUMIGRID_ASSIGN_OR_RETURN(auto picture,
                            renderer.render(base::cameraForScene(request.camera, origin, bounds),
                                            exactFrameOptions(request.camera.width, request.camera.height)));
  auto encoded = encodeFrame(picture.rgba, request.codec, request.quality);
  drawn_.add(job.scene, request.camera, std::move(picture.rgba));
  return encoded;
}

base::Result<std::unique_ptr<FrameRenderer>> FrameRenderer::start(const std::vector<const OpenScene*>& scenes) {
  std::unique_ptr<FrameRenderer> renderer(new FrameRenderer(scenes));
  std::promise<base::Result<void>> promise;
  auto started = promise.get_future();
  renderer->thread_ = std::jthread([raw = renderer.get(), p = std::move(promise)](const std::stop_token& stop) mutable {
    raw->runThread(stop, std::move(p));
  });
  LUMIGRID_TRY(started.get());
  return renderer;
}

void FrameRenderer::requestFrame(std::uint64_t client, std::size_t scene, const FrameRequest& request, OnFrame done) {
  cancel(client);
  std::lock_guard lock(mutex_);
  queue_.push_back({client, scene, request, std::move(done)});
  changed_.notify_one();
}

void FrameRenderer::setLight(std::size_t scene, const base::Light& light) {
  const std::lock_guard lock(mutex_);
  lights_[scene] = light;
}

bool FrameRenderer::requestPicture(std::uint64_t client, std::size_t scene, const PictureRequest& request,
                                   std::size_t max_waiting, OnPicture done) {
  const std::lock_guard lock(mutex_);
  if (pictures_.size() >= max_waiting + (current_client_ ? 0 : 1)) return false;
  pictures_.push_back({client, scene, request, std::move(done), nullptr});
  changed_.notify_one();
  return true;
}

void FrameRenderer::cancel(std::uint64_t client) {
  const std::lock_guard lock(mutex_);
  std::erase_if(queue_, [client](const FrameJob& job) { return job.client == client; });
  std::erase_if(pictures_, [client](const PictureJob& job) { return job.client == client; });
  if (current_client_ == client) current_cancelled_ = true;
}

}  // namespace server
