#include "server/net/frame_renderer.h"

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <thread>
#include <utility>

#include "base/egl/headless.h"
#include "repository/faces/jpeg.h"
#include "server/bake/face_encoder.h"
#include "server/render/scene_renderer.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr int kFullColorQuality = 90;  // from here on colours are not halved: they are what is left to see
constexpr std::uint64_t kPatchBytes = std::uint64_t{2} << 30;  // uploaded patches, of all scenes together
constexpr RenderOptions kExact{.tolerance_px = 0.25F, .supersampling = 2};

}  // namespace

struct FrameRenderer::State {
  struct Job {
    std::uint64_t client = 0;
    std::size_t scene = 0;
    FrameRequest request;
    Done done;
  };
  struct PictureJob {
    std::uint64_t client = 0;
    std::size_t scene = 0;
    PictureRequest request;
    Painted done;
    std::unique_ptr<PicturePainter> painter;  // of the thread alone; null: not begun
  };

  explicit State(const std::vector<const OpenScene*>& opened) : scenes(opened) {}
  void work(std::promise<base::Result<void>> started);
  bool waitForWork(std::optional<Job>& frame);
  base::Result<void> makeRenderers();
  base::Bytes render(const Job& job) const;
  void paintBand();
  base::Result<bool> step(PictureJob& job) const;

  const std::vector<const OpenScene*> scenes;
  std::vector<std::unique_ptr<SceneRenderer>> renderers;  // of the thread alone; beside `scenes`
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Job> queue;                  // one per client at most, oldest first
  std::deque<PictureJob> pictures;        // oldest first
  std::optional<std::uint64_t> painting;  // whose picture is in hand
  bool given_up = false;                  // nobody wants it any more
  bool stopping = false;
  std::optional<PictureJob> in_hand;  // of the thread alone
  std::thread thread;
};

void FrameRenderer::State::work(std::promise<base::Result<void>> started) {
  auto context = base::HeadlessContext::create();
  if (!context) return started.set_value(context.error());
  if (auto made = makeRenderers(); !made) {
    renderers.clear();
    return started.set_value(made.error());
  }
  spdlog::info("frames: rendered by {}", (*context)->renderer());
  started.set_value({});
  std::optional<Job> frame;
  while (waitForWork(frame)) {
    if (frame) frame->done(render(*frame));
    if (in_hand) paintBand();
  }
  in_hand.reset();
  renderers.clear();  // their GL objects go before the context does
}

/// They share what one would take of the GPU's memory. Scenes of splats alone have none.
base::Result<void> FrameRenderer::State::makeRenderers() {
  for (const OpenScene* scene : scenes) {
    if (scene->data.patches == nullptr) {
      renderers.push_back(nullptr);
      continue;
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto renderer,
                              SceneRenderer::create(scene->scene, scene->patches, kPatchBytes / scenes.size()));
    renderers.push_back(std::move(renderer));
  }
  return {};
}

/// The next frame, if one waits, and a picture in hand, if any does. False: the end.
bool FrameRenderer::State::waitForWork(std::optional<Job>& frame) {
  std::unique_lock lock(mutex);
  if (std::exchange(given_up, false)) {
    in_hand.reset();
    painting.reset();
  }
  changed.wait(lock, [this] { return stopping || in_hand || !queue.empty() || !pictures.empty(); });
  if (stopping) return false;
  frame.reset();
  if (!queue.empty()) {
    frame = std::move(queue.front());
    queue.pop_front();
  }
  if (!in_hand && !pictures.empty()) {
    in_hand = std::move(pictures.front());
    pictures.pop_front();
    painting = in_hand->client;
  }
  return true;
}

void FrameRenderer::State::paintBand() {
  const auto whole = step(*in_hand);
  if (whole && !*whole) return;
  if (!whole) spdlog::warn("picture: {}", whole.error().message);
  {
    const std::lock_guard lock(mutex);
    painting.reset();
    if (std::exchange(given_up, false)) return in_hand.reset();
  }
  if (whole)
    in_hand->done(in_hand->painter->take());
  else
    in_hand->done(whole.error());
  in_hand.reset();
}

base::Result<bool> FrameRenderer::State::step(PictureJob& job) const {
  SceneRenderer& renderer = *renderers[job.scene];
  if (!job.painter) {
    LUMIGRID_ASSIGN_OR_RETURN(auto begun, PicturePainter::begin(job.request, scenes[job.scene]->scene, renderer));
    job.painter = std::move(begun);
  }
  return job.painter->step(renderer);
}

base::Bytes FrameRenderer::State::render(const Job& job) const {
  const FrameRequest& request = job.request;
  const glm::dvec3& origin = scenes[job.scene]->scene.origin;
  SceneRenderer& renderer = *renderers[job.scene];
  const glm::vec3 eye(request.camera.position - origin);
  const base::DepthRange depth = base::depthRangeFor(eye, renderer.sceneCenter(), renderer.sceneRadius());
  auto picture =
      renderer.render(base::cameraFromView(request.camera, origin, depth.near_plane, depth.far_plane), kExact);
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

base::Result<std::unique_ptr<FrameRenderer>> FrameRenderer::start(const std::vector<const OpenScene*>& scenes) {
  std::unique_ptr<FrameRenderer> renderer(new FrameRenderer);
  renderer->state_ = std::make_unique<State>(scenes);
  std::promise<base::Result<void>> promise;
  auto started = promise.get_future();
  State& state = *renderer->state_;
  state.thread = std::thread([&state, p = std::move(promise)]() mutable { state.work(std::move(p)); });
  LUMIGRID_TRY(started.get());
  return renderer;
}

FrameRenderer::~FrameRenderer() {
  {
    std::lock_guard lock(state_->mutex);
    state_->stopping = true;
    state_->queue.clear();
    state_->pictures.clear();
  }
  state_->changed.notify_all();
  if (state_->thread.joinable()) state_->thread.join();
}

void FrameRenderer::submit(std::uint64_t client, std::size_t scene, const FrameRequest& request, Done done) {
  cancel(client);
  std::lock_guard lock(state_->mutex);
  state_->queue.push_back({client, scene, request, std::move(done)});
  state_->changed.notify_one();
}

bool FrameRenderer::paint(std::uint64_t client, std::size_t scene, const PictureRequest& request,
                          std::size_t max_waiting, Painted done) {
  const std::lock_guard lock(state_->mutex);
  if (state_->pictures.size() >= max_waiting + (state_->painting ? 0 : 1)) return false;
  state_->pictures.push_back({client, scene, request, std::move(done), nullptr});
  state_->changed.notify_one();
  return true;
}

void FrameRenderer::cancel(std::uint64_t client) {
  const std::lock_guard lock(state_->mutex);
  std::erase_if(state_->queue, [client](const State::Job& job) { return job.client == client; });
  std::erase_if(state_->pictures, [client](const State::PictureJob& job) { return job.client == client; });
  if (state_->painting == client) state_->given_up = true;
}

}  // namespace server
