#include "server/net/frame_renderer.h"

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <thread>
#include <utility>

#include "base/egl/headless.h"
#include "base/view_defaults.h"
#include "server/bake/face_encoder.h"
#include "server/render/scene_renderer.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr std::uint64_t kPatchBytes = std::uint64_t{2} << 30;  // GPU memory for the patches of all scenes together
constexpr RenderOptions kExactFrame{.tolerance_px = base::ViewDefaults::kExactTolerance, .supersampling = 2};

}  // namespace

struct FrameRenderer::Impl {
  struct FrameJob {
    std::uint64_t client = 0;
    std::size_t scene = 0;
    FrameRequest request;
    OnFrame done;
  };
  struct PictureJob {
    std::uint64_t client = 0;
    std::size_t scene = 0;
    PictureRequest request;
    OnPicture done;
    std::unique_ptr<PicturePainter> painter;  // used by the thread alone; null: not begun
  };

  explicit Impl(const std::vector<const OpenScene*>& opened) : scenes(opened) {}
  void runThread(std::promise<base::Result<void>> started);
  bool waitForWork(std::optional<FrameJob>& frame);
  base::Result<void> makeRenderers();
  base::Bytes renderFrame(const FrameJob& job) const;
  void drawPictureBand();
  base::Result<bool> drawNextBand(PictureJob& job) const;

  const std::vector<const OpenScene*> scenes;
  std::vector<std::unique_ptr<SceneRenderer>> renderers;  // used by the thread alone; parallel to `scenes`
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<FrameJob> queue;                   // one per client at most, oldest first
  std::deque<PictureJob> pictures;              // oldest first
  std::optional<std::uint64_t> current_client;  // the client of current_picture
  bool current_cancelled = false;               // nobody wants current_picture any more
  bool stopping = false;
  std::optional<PictureJob> current_picture;  // used by the thread alone
  std::thread thread;
};

void FrameRenderer::Impl::runThread(std::promise<base::Result<void>> started) {
  auto context = base::HeadlessContext::create();
  if (!context) return started.set_value(context.error());
  if (auto made = makeRenderers(); !made) {
    renderers.clear();
    return started.set_value(made.error());
  }
  spdlog::info("frames: rendered by {}", (*context)->renderer());
  started.set_value({});
  std::optional<FrameJob> frame;
  while (waitForWork(frame)) {
    if (frame) frame->done(renderFrame(*frame));
    if (current_picture) drawPictureBand();
  }
  current_picture.reset();
  renderers.clear();  // their GL objects go before the context does
}

/// The renderers share the GPU memory that one would take. Splats-only scenes have none.
base::Result<void> FrameRenderer::Impl::makeRenderers() {
  for (const OpenScene* scene : scenes) {
    renderers.emplace_back();
    if (scene->data.patches == nullptr) continue;
    LUMIGRID_ASSIGN_OR_RETURN(renderers.back(),
                              SceneRenderer::create(scene->scene, scene->patches, kPatchBytes / scenes.size()));
  }
  return {};
}

/// Waits for a request. Sets `frame` to the next frame, if one waits, and keeps or begins the current picture. Returns
/// false when the renderer stops.
bool FrameRenderer::Impl::waitForWork(std::optional<FrameJob>& frame) {
  std::unique_lock lock(mutex);
  if (std::exchange(current_cancelled, false)) {
    current_picture.reset();
    current_client.reset();
  }
  changed.wait(lock, [this] { return stopping || current_picture || !queue.empty() || !pictures.empty(); });
  if (stopping) return false;
  frame.reset();
  if (!queue.empty()) {
    frame = std::move(queue.front());
    queue.pop_front();
  }
  if (!current_picture && !pictures.empty()) {
    current_picture = std::move(pictures.front());
    pictures.pop_front();
    current_client = current_picture->client;
  }
  return true;
}

void FrameRenderer::Impl::drawPictureBand() {
  const auto whole = drawNextBand(*current_picture);
  if (whole && !*whole) return;
  if (!whole) spdlog::warn("picture: {}", whole.error().message);
  {
    const std::lock_guard lock(mutex);
    current_client.reset();
    if (std::exchange(current_cancelled, false)) return current_picture.reset();
  }
  if (whole)
    current_picture->done(current_picture->painter->takePicture());
  else
    current_picture->done(whole.error());
  current_picture.reset();
}

base::Result<bool> FrameRenderer::Impl::drawNextBand(PictureJob& job) const {
  SceneRenderer& renderer = *renderers[job.scene];
  if (!job.painter) {
    LUMIGRID_ASSIGN_OR_RETURN(job.painter, PicturePainter::begin(job.request, scenes[job.scene]->scene, renderer));
  }
  return job.painter->drawNextBand(renderer);
}

base::Bytes FrameRenderer::Impl::renderFrame(const FrameJob& job) const {
  const FrameRequest& request = job.request;
  const glm::dvec3& origin = scenes[job.scene]->scene.origin;
  SceneRenderer& renderer = *renderers[job.scene];
  const glm::vec3 eye(request.camera.position - origin);
  const base::DepthRange depth = base::depthRangeFor(eye, renderer.sceneCenter(), renderer.sceneRadius());
  auto picture =
      renderer.render(base::cameraFromView(request.camera, origin, depth.near_plane, depth.far_plane), kExactFrame);
  auto encoded =
      picture ? encodeFace(picture->rgba, request.quality, subsamplingFor(request.quality)) : picture.error();
  if (!encoded) {
    spdlog::warn("frames: {}", encoded.error().message);
    return {};
  }
  return std::move(encoded->value);
}

base::Result<std::unique_ptr<FrameRenderer>> FrameRenderer::start(const std::vector<const OpenScene*>& scenes) {
  std::unique_ptr<FrameRenderer> renderer(new FrameRenderer);
  renderer->impl_ = std::make_unique<Impl>(scenes);
  std::promise<base::Result<void>> promise;
  auto started = promise.get_future();
  Impl& impl = *renderer->impl_;
  impl.thread = std::thread([&impl, p = std::move(promise)]() mutable { impl.runThread(std::move(p)); });
  LUMIGRID_TRY(started.get());
  return renderer;
}

FrameRenderer::~FrameRenderer() {
  {
    std::lock_guard lock(impl_->mutex);
    impl_->stopping = true;
    impl_->queue.clear();
    impl_->pictures.clear();
  }
  impl_->changed.notify_all();
  if (impl_->thread.joinable()) impl_->thread.join();
}

void FrameRenderer::requestFrame(std::uint64_t client, std::size_t scene, const FrameRequest& request, OnFrame done) {
  cancel(client);
  std::lock_guard lock(impl_->mutex);
  impl_->queue.push_back({client, scene, request, std::move(done)});
  impl_->changed.notify_one();
}

bool FrameRenderer::requestPicture(std::uint64_t client, std::size_t scene, const PictureRequest& request,
                                   std::size_t max_waiting, OnPicture done) {
  const std::lock_guard lock(impl_->mutex);
  if (impl_->pictures.size() >= max_waiting + (impl_->current_client ? 0 : 1)) return false;
  impl_->pictures.push_back({client, scene, request, std::move(done), nullptr});
  impl_->changed.notify_one();
  return true;
}

void FrameRenderer::cancel(std::uint64_t client) {
  const std::lock_guard lock(impl_->mutex);
  std::erase_if(impl_->queue, [client](const Impl::FrameJob& job) { return job.client == client; });
  std::erase_if(impl_->pictures, [client](const Impl::PictureJob& job) { return job.client == client; });
  if (impl_->current_client == client) impl_->current_cancelled = true;
}

}  // namespace server
