#include "server/net/frame_renderer.h"

#include <algorithm>
#include <utility>

#include "base/egl/headless.h"
#include "base/parallel.h"
#include "server/bake/frame_encoder.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr std::uint64_t kPatchBytes = std::uint64_t{2} << 30;  // GPU memory for the patches of all scenes together
constexpr std::size_t kDrawnBytes = std::size_t{64} << 20;     // eighteen pictures of 1280 x 720, two of 4K
// Large frames that are drawn or encoded at a time. Each holds up to 64 MB, and being encoded 200 MB more, so that one
// is at a time; small frames go on meanwhile.
constexpr std::size_t kMaxLarge = 2;
constexpr std::uint64_t kMaxEncodingBytes = std::uint64_t{128} << 20;

std::uint64_t pixelsOf(const base::ViewCamera& camera) {
  return static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
}

bool isLarge(const base::ViewCamera& camera) {
  return pixelsOf(camera) > FramePainter::kBandPixels;
}

}  // namespace

FrameRenderer::FrameRenderer() : drawn_(kDrawnBytes), encoders_(base::coreCount()), large_encoders_(1) {}

// ---- The thread

void FrameRenderer::runThread(const std::stop_token& stop, const std::vector<ScenePointer>& scenes,
                              std::promise<base::Result<void>> started) {
  takeUpScenes();
  auto context = base::HeadlessContext::create();
  if (!context) return started.set_value(context.error());
  for (const ScenePointer& scene : scenes) {
    const auto made = rendererOf(scene);
    if (made) continue;
    renderers_.clear();
    return started.set_value(made.error());
  }
  spdlog::info("frames: rendered by {}", (*context)->renderer());
  started.set_value({});
  while (waitForWork(stop)) {
    takeUpScenes();
    if (current_frame_) drawFrameBand();
    if (current_picture_) drawPictureBand();
  }
  current_frame_.reset();
  current_picture_.reset();
  renderers_.clear();  // their GL objects go before the context does
}

/// The scenes share the GPU memory that patches of one would take. Shadows of each take more (docs/shadows.md).
base::Result<SceneRenderer*> FrameRenderer::rendererOf(const ScenePointer& scene) {
  const auto known = renderers_.find(scene.get());
  if (known == renderers_.end()) return base::Error{base::ErrorCode::kNotFound, scene->name + ": is no longer served"};
  Drawn& drawn = known->second;
  if (!drawn.renderer) {
    LUMIGRID_ASSIGN_OR_RETURN(drawn.renderer,
                              SceneRenderer::create(drawn.described, scene->patches, kPatchBytes / renderers_.size()));
  }
  return drawn.renderer.get();
}

bool FrameRenderer::isBeingDrawn(const ScenePointer& scene) const {
  const auto draws = [&](const auto& job) { return job && job->painter && job->scene == scene; };
  return draws(current_picture_) || draws(current_frame_) ||
         std::any_of(frames_.begin(), frames_.end(),
                     [&](const FrameJob& job) { return job.painter && job.scene == scene; });
}

bool FrameRenderer::isAskedFor(const ScenePointer& scene) const {
  const auto asks = [&](const auto& job) { return job.scene == scene; };
  return (current_picture_ && asks(*current_picture_)) || (current_frame_ && asks(*current_frame_)) ||
         std::any_of(frames_.begin(), frames_.end(), asks) || std::any_of(pictures_.begin(), pictures_.end(), asks);
}

bool FrameRenderer::canForget() const {
  return std::any_of(forgotten_.begin(), forgotten_.end(),
                     [this](const ScenePointer& scene) { return !isAskedFor(scene); });
}

/// A picture that is drawn in part is drawn to its end by the light it began with, and so are frames of its scene
/// meanwhile.
void FrameRenderer::takeUpScenes() {
  std::vector<Drawn> added;
  std::map<ScenePointer, base::Light> lights;
  std::vector<ScenePointer> forgotten;
  {
    const std::lock_guard lock(mutex_);
    added.swap(added_);
    for (auto it = lights_.begin(); it != lights_.end();) {
      const auto next = std::next(it);
      if (!isBeingDrawn(it->first)) lights.insert(lights_.extract(it));
      it = next;
    }
    std::erase_if(forgotten_, [&](const ScenePointer& scene) {
      if (isAskedFor(scene)) return false;
      forgotten.push_back(scene);
      return true;
    });
  }
  for (Drawn& one : added) {
    const OpenScene* const scene = one.scene.get();
    renderers_.emplace(scene, std::move(one));
  }
  for (const auto& [scene, light] : lights) {
    drawn_.forget(scene.get());
    const auto renderer = rendererOf(scene);
    const auto done = renderer ? (*renderer)->setLight(light) : base::Result<void>(renderer.error());
    if (!done) spdlog::warn("light: {}", done.error().message);
  }
  for (const ScenePointer& scene : forgotten) {
    drawn_.forget(scene.get());
    renderers_.erase(scene.get());
  }
}

/// The frame of which a band comes next; the end where none may be begun now.
std::list<FrameRenderer::FrameJob>::iterator FrameRenderer::nextFrame() {
  auto best = frames_.end();
  const auto usedBy = [this](const FrameJob& job) { return shares_.usedBy(job.client, job.address); };
  for (auto job = frames_.begin(); job != frames_.end(); ++job) {
    if (isLarge(job->request.camera) && !job->painter && begun_ + large_encoding_ >= kMaxLarge) continue;
    if (!job->painter && encoding_bytes_ > kMaxEncodingBytes) continue;
    if (best == frames_.end() || std::pair(usedBy(*job), job->number) < std::pair(usedBy(*best), best->number))
      best = job;
  }
  return best;
}

/// Waits for a request. Sets the current frame, if one waits, and keeps or begins the current picture. Returns false
/// when the renderer stops.
bool FrameRenderer::waitForWork(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  if (std::exchange(picture_cancelled_, false)) {
    current_picture_.reset();
    picture_client_.reset();
  }
  auto frame = frames_.end();
  changed_.wait(lock, stop, [&] {
    frame = nextFrame();
    return current_picture_ || frame != frames_.end() || !pictures_.empty() || canForget();
  });
  if (stop.stop_requested()) return false;
  if (frame != frames_.end()) {
    current_frame_ = std::move(*frame);
    frames_.erase(frame);
    frame_client_ = current_frame_->client;
    frame_cancelled_ = false;
  }
  if (!current_picture_ && !pictures_.empty()) {
    current_picture_ = std::move(pictures_.front());
    pictures_.pop_front();
    picture_client_ = current_picture_->client;
    picture_address_ = current_picture_->address;
  }
  return true;
}

void FrameRenderer::drawFrameBand() {
  FrameJob job = std::move(*current_frame_);
  current_frame_.reset();
  const bool was_begun = job.painter != nullptr;
  std::shared_ptr<const base::Image> picture;
  base::Result<bool> whole = true;
  if (!was_begun) picture = drawn_.find(job.scene.get(), job.request.camera);
  if (!was_begun) ++(picture ? found_ : not_found_);
  if (!picture) whole = drawNextBand(job);
  if (!whole) job.scene->read_errors->report("frames", whole.error());
  if (whole && *whole && !picture) {
    picture = std::make_shared<const base::Image>(job.painter->takePicture());
    drawn_.add(job.scene.get(), job.request.camera, picture);
  }

  std::unique_lock lock(mutex_);
  frame_client_.reset();
  const bool goes_on = whole && !*whole && !frame_cancelled_;
  if (goes_on && !was_begun) ++begun_;
  if (!goes_on && was_begun) --begun_;
  if (goes_on) return frames_.push_back(std::move(job));
  if (frame_cancelled_) return;
  lock.unlock();
  if (picture)
    encode(std::move(job), std::move(picture));
  else
    job.done({});
}

base::Result<bool> FrameRenderer::drawNextBand(FrameJob& job) {
  LUMIGRID_ASSIGN_OR_RETURN(SceneRenderer* const renderer, rendererOf(job.scene));
  if (!job.painter) job.painter = std::make_unique<FramePainter>(job.request.camera, job.scene->scene, *renderer);
  {
    const std::lock_guard lock(mutex_);
    const std::uint64_t pixels = std::min(pixelsOf(job.request.camera), FramePainter::kBandPixels);
    // A client that has gone was forgotten.
    if (!frame_cancelled_) shares_.charge(job.client, job.address, static_cast<double>(pixels));
  }
  return job.painter->drawNextBand(*renderer);
}

/// A picture that is being encoded, or waits for it. Its bytes are counted, even if the encoders drop it.
struct FrameRenderer::Encoding {
  Encoding(FrameRenderer& owner, FrameJob asked, std::shared_ptr<const base::Image> drawn)
      : renderer(owner), job(std::move(asked)), picture(std::move(drawn)) {
    const std::lock_guard lock(renderer.mutex_);
    renderer.encoding_bytes_ += picture->pixels.size();
    if (isLarge(job.request.camera)) ++renderer.large_encoding_;
  }
  ~Encoding() {
    const std::lock_guard lock(renderer.mutex_);
    renderer.encoding_bytes_ -= picture->pixels.size();
    if (isLarge(job.request.camera)) --renderer.large_encoding_;
    renderer.changed_.notify_one();
  }
  Encoding(const Encoding&) = delete;
  Encoding& operator=(const Encoding&) = delete;

  FrameRenderer& renderer;
  const FrameJob job;
  const std::shared_ptr<const base::Image> picture;
};

/// Encoding takes as long as drawing, and needs no GL.
void FrameRenderer::encode(FrameJob job, std::shared_ptr<const base::Image> picture) {
  const std::uint64_t client = job.client;
  FairQueue& encoders = isLarge(job.request.camera) ? large_encoders_ : encoders_;
  encoders.submit(client, [encoding = std::make_shared<Encoding>(*this, std::move(job), std::move(picture))] {
    const FrameRequest& request = encoding->job.request;
    auto encoded = encodeFrame(*encoding->picture, request.codec, request.quality);
    if (!encoded) encoding->job.scene->read_errors->report("frames", encoded.error());
    encoding->job.done(encoded ? std::move(*encoded) : protocol::EncodedFrame());
  });
}

void FrameRenderer::drawPictureBand() {
  const auto whole = drawNextBand(*current_picture_);
  if (whole && !*whole) return;
  if (!whole) current_picture_->scene->read_errors->report("picture", whole.error());
  {
    const std::lock_guard lock(mutex_);
    picture_client_.reset();
    if (std::exchange(picture_cancelled_, false)) return current_picture_.reset();
  }
  if (whole)
    current_picture_->done(current_picture_->painter->takePicture());
  else
    current_picture_->done(whole.error());
  current_picture_.reset();
}

base::Result<bool> FrameRenderer::drawNextBand(PictureJob& job) {
  LUMIGRID_ASSIGN_OR_RETURN(SceneRenderer* const renderer, rendererOf(job.scene));
  if (!job.painter) {
    LUMIGRID_ASSIGN_OR_RETURN(job.painter, PicturePainter::begin(job.request, job.scene->scene, *renderer));
  }
  return job.painter->drawNextBand(*renderer);
}

// ---- The other threads

base::Result<std::unique_ptr<FrameRenderer>> FrameRenderer::start(const std::vector<ScenePointer>& scenes) {
  std::unique_ptr<FrameRenderer> renderer(new FrameRenderer);
  for (const ScenePointer& scene : scenes) renderer->addScene(scene);
  std::promise<base::Result<void>> promise;
  auto started = promise.get_future();
  renderer->thread_ =
      std::jthread([raw = renderer.get(), scenes, p = std::move(promise)](const std::stop_token& stop) mutable {
        raw->runThread(stop, scenes, std::move(p));
      });
  LUMIGRID_TRY(started.get());
  return renderer;
}

void FrameRenderer::requestFrame(std::uint64_t client, const std::string& address, ScenePointer scene,
                                 const FrameRequest& request, OnFrame done) {
  for (FairQueue* const encoders : {&encoders_, &large_encoders_}) {
    encoders->setAddress(client, address);
    encoders->drop(client);
  }
  drop(client);
  const std::lock_guard lock(mutex_);
  frames_.push_back({client, address, next_number_++, std::move(scene), request, std::move(done)});
  changed_.notify_one();
}

void FrameRenderer::addScene(const ScenePointer& scene) {
  const std::lock_guard lock(mutex_);
  added_.push_back({scene, scene->scene});
}

void FrameRenderer::setLight(const ScenePointer& scene, const base::Light& light) {
  const std::lock_guard lock(mutex_);
  lights_[scene] = light;
}

FrameRenderer::Counts FrameRenderer::counts() {
  const std::lock_guard lock(mutex_);
  return {frames_.size(), pictures_.size(), found_, not_found_};
}

void FrameRenderer::forgetScene(const ScenePointer& scene) {
  const std::lock_guard lock(mutex_);
  forgotten_.push_back(scene);
  changed_.notify_one();
}

bool FrameRenderer::requestPicture(std::uint64_t client, const std::string& address, ScenePointer scene,
                                   const PictureRequest& request, const PictureLimits& limits, OnPicture done) {
  const std::lock_guard lock(mutex_);
  if (pictures_.size() >= limits.waiting + (picture_client_ ? 0 : 1)) return false;
  std::size_t of_address = picture_client_ && picture_address_ == address ? 1 : 0;
  for (const PictureJob& job : pictures_) of_address += job.address == address ? 1 : 0;
  if (of_address >= limits.of_one_address) return false;
  pictures_.push_back({client, address, std::move(scene), request, std::move(done)});
  changed_.notify_one();
  return true;
}

void FrameRenderer::cancel(std::uint64_t client) {
  encoders_.forget(client);
  large_encoders_.forget(client);
  drop(client);
  const std::lock_guard lock(mutex_);
  shares_.forget(client);
}

void FrameRenderer::drop(std::uint64_t client) {
  const std::lock_guard lock(mutex_);
  std::erase_if(frames_, [&](const FrameJob& job) {
    if (job.client == client && job.painter) --begun_;
    return job.client == client;
  });
  std::erase_if(pictures_, [client](const PictureJob& job) { return job.client == client; });
  if (frame_client_ == client) frame_cancelled_ = true;
  if (picture_client_ == client) picture_cancelled_ = true;
}

}  // namespace server
