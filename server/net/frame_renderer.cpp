#include "server/net/frame_renderer.h"

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <thread>
#include <utility>

#include "base/egl/headless.h"
#include "repository/jpeg.h"
#include "server/bake/face_encoder.h"
#include "server/render/scene_renderer.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr int kFullColorQuality = 90;  // from here on colours are not halved: they are what is left to see
constexpr RenderOptions kExact{.tolerance_px = 0.25F, .supersampling = 2};

}  // namespace

struct FrameRenderer::State {
  struct Job {
    std::uint64_t client = 0;
    FrameRequest request;
    Done done;
  };

  explicit State(const OpenScene& opened) : scene(opened) {}
  void work(std::promise<base::Result<void>> started);
  std::optional<Job> waitForJob();
  base::Bytes render(SceneRenderer& renderer, const FrameRequest& request) const;

  const OpenScene& scene;
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Job> queue;  // one per client at most, oldest first
  bool stopping = false;
  std::thread thread;
};

void FrameRenderer::State::work(std::promise<base::Result<void>> started) {
  auto context = base::HeadlessContext::create();
  if (!context) return started.set_value(context.error());
  {
    // The renderer's GL objects go before the context does.
    auto renderer = SceneRenderer::create(scene.scene, scene.patches);
    if (!renderer) return started.set_value(renderer.error());
    spdlog::info("frames: rendered by {}", (*context)->renderer());
    started.set_value({});
    while (auto job = waitForJob()) job->done(render(**renderer, job->request));
  }
}

std::optional<FrameRenderer::State::Job> FrameRenderer::State::waitForJob() {
  std::unique_lock lock(mutex);
  changed.wait(lock, [this] { return stopping || !queue.empty(); });
  if (stopping) return std::nullopt;
  Job job = std::move(queue.front());
  queue.pop_front();
  return job;
}

base::Bytes FrameRenderer::State::render(SceneRenderer& renderer, const FrameRequest& request) const {
  const glm::vec3 eye(request.camera.position - scene.scene.origin);
  const base::DepthRange depth = base::depthRangeFor(eye, renderer.sceneCenter(), renderer.sceneRadius());
  auto picture = renderer.render(
      base::cameraFromView(request.camera, scene.scene.origin, depth.near_plane, depth.far_plane), kExact);
  if (!picture) {
    spdlog::warn("frames: {}", picture.error().message);
    return {};
  }
  const auto subsampling =
      request.quality >= kFullColorQuality ? repository::Subsampling::k444 : repository::Subsampling::k420;
  auto encoded = encodeFace(picture->rgba, request.quality, subsampling);
  if (!encoded) {
    spdlog::warn("frames: {}", encoded.error().message);
    return {};
  }
  return std::move(encoded->value);
}

base::Result<std::unique_ptr<FrameRenderer>> FrameRenderer::start(const OpenScene& scene) {
  std::unique_ptr<FrameRenderer> renderer(new FrameRenderer);
  renderer->state_ = std::make_unique<State>(scene);
  std::promise<base::Result<void>> promise;
  auto started = promise.get_future();
  State& state = *renderer->state_;
  state.thread = std::thread([&state, p = std::move(promise)]() mutable { state.work(std::move(p)); });
  const base::Result<void> result = started.get();
  if (!result) return result.error();
  return renderer;
}

FrameRenderer::~FrameRenderer() {
  {
    std::lock_guard lock(state_->mutex);
    state_->stopping = true;
    state_->queue.clear();
  }
  state_->changed.notify_all();
  if (state_->thread.joinable()) state_->thread.join();
}

void FrameRenderer::submit(std::uint64_t client, const FrameRequest& request, Done done) {
  cancel(client);
  std::lock_guard lock(state_->mutex);
  state_->queue.push_back({client, request, std::move(done)});
  state_->changed.notify_one();
}

void FrameRenderer::cancel(std::uint64_t client) {
  std::lock_guard lock(state_->mutex);
  std::erase_if(state_->queue, [client](const State::Job& job) { return job.client == client; });
}

}  // namespace server
