#include "server/net/frame_renderer.h"

#include <algorithm>
#include <array>
#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <thread>
#include <utility>

#include "base/egl/headless.h"
#include "repository/coverage.h"
#include "repository/face_value.h"
#include "repository/jpeg.h"
#include "server/render/scene_renderer.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr int kBlock = 16;              // pixels of a JPEG block with halved colours
constexpr std::uint8_t kCovered = 128;  // alpha: at least half of the pixel's samples saw the model
constexpr RenderOptions kExact{.tolerance_px = 0.5F, .supersampling = 2};

struct Colors {
  std::array<std::uint64_t, 3> sum{};
  std::uint64_t count = 0;
  void add(const std::uint8_t* pixel) {
    for (std::size_t c = 0; c < 3; ++c) sum[c] += pixel[c];
    ++count;
  }
};

/// Background pixels of a block take the mean colour of its model pixels; a block without any, the picture's mean.
base::Image withoutBackground(const base::Image& rgba) {
  Colors all;
  for (std::size_t i = 0; i < rgba.pixels.size(); i += 4)
    if (rgba.pixels[i + 3] >= kCovered) all.add(&rgba.pixels[i]);

  base::Image rgb(rgba.width, rgba.height, 3);
  for (int top = 0; top < rgba.height; top += kBlock) {
    for (int left = 0; left < rgba.width; left += kBlock) {
      const int bottom = std::min(top + kBlock, rgba.height);
      const int right = std::min(left + kBlock, rgba.width);
      Colors block;
      for (int y = top; y < bottom; ++y)
        for (int x = left; x < right; ++x)
          if (rgba.at(x, y)[3] >= kCovered) block.add(rgba.at(x, y));
      const Colors& mean = block.count != 0 ? block : all;
      for (int y = top; y < bottom; ++y) {
        for (int x = left; x < right; ++x) {
          const std::uint8_t* from = rgba.at(x, y);
          for (std::size_t c = 0; c < 3; ++c)
            rgb.at(x, y)[c] = from[3] >= kCovered
                                  ? from[c]
                                  : static_cast<std::uint8_t>(mean.sum[c] / std::max<std::uint64_t>(1, mean.count));
        }
      }
    }
  }
  return rgb;
}

}  // namespace

base::Result<base::Bytes> encodeFrameValue(const base::Image& rgba, int quality) {
  base::Image mask(rgba.width, rgba.height, 1);
  std::size_t covered = 0;
  for (std::size_t i = 0; i < mask.pixels.size(); ++i) {
    mask.pixels[i] = rgba.pixels[4 * i + 3] >= kCovered ? 255 : 0;
    covered += mask.pixels[i] != 0 ? 1 : 0;
  }
  if (covered == 0) return repository::encodeFaceValue({});

  const auto subsampling = quality >= 90 ? repository::Subsampling::k444 : repository::Subsampling::k420;
  auto jpeg = repository::encodeJpeg(withoutBackground(rgba), quality, subsampling);
  if (!jpeg) return jpeg.error();
  const base::Bytes coverage = covered == mask.pixels.size() ? base::Bytes{} : repository::encodeCoverage(mask);
  return repository::encodeFaceValue({.empty = false, .jpeg = *jpeg, .coverage = coverage});
}

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
  auto value = encodeFrameValue(picture->rgba, request.quality);
  if (!value) {
    spdlog::warn("frames: {}", value.error().message);
    return {};
  }
  return std::move(*value);
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
