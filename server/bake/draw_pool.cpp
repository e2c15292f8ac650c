#include "server/bake/draw_pool.h"

#include <algorithm>
#include <utility>

#include "base/egl/headless.h"
#include "server/bake/face_sample.h"

namespace server {
namespace {

// Mesa's llvmpipe (22.3) crashes in its own code once in fifty bakes when several contexts draw at a time; with one
// it never did. So one, until that is understood, though four draw half as fast again.
constexpr unsigned kMostThreads = 1;
// Uploaded patches, of all contexts together; but no context gets less than it needs for one cut of a large scan.
constexpr std::uint64_t kGpuBudgetBytes = std::uint64_t{2} << 30;
constexpr std::uint64_t kLeastGpuBudgetBytes = std::uint64_t{256} << 20;

}  // namespace

base::Result<unsigned> DrawPool::threadsFor(unsigned threads) {
  auto context = base::HeadlessContext::create();
  if (!context) return context.error();
  return (*context)->isSoftware() ? std::clamp(threads, 1U, kMostThreads) : 1U;
}

DrawPool::DrawPool(const base::Scene& scene, const lod::patch::PatchFile& patches, const repository::Grid& grid,
                   const RenderOptions& options, unsigned threads, Take take, Fail fail)
    : scene_(scene),
      patches_(patches),
      grid_(grid),
      options_(options),
      queue_limit_(threads),
      take_(std::move(take)),
      fail_(std::move(fail)) {
  for (unsigned i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

DrawPool::~DrawPool() {
  finish();
}

void DrawPool::submit(DrawJob job) {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return failed_ || queue_.size() < queue_limit_; });
    if (failed_) return;
    queue_.push_back(std::move(job));
  }
  changed_.notify_all();
}

void DrawPool::finish() {
  {
    const std::lock_guard lock(mutex_);
    finishing_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_)
    if (thread.joinable()) thread.join();
}

void DrawPool::work() {
  const base::Result<void> drawn = draw();
  if (drawn) return;
  bool first = false;
  {
    const std::lock_guard lock(mutex_);
    first = !std::exchange(failed_, true);
    queue_.clear();
  }
  changed_.notify_all();
  if (first) fail_(drawn.error());
}

base::Result<void> DrawPool::draw() {
  auto context = base::HeadlessContext::create();
  if (!context) return context.error();
  const std::uint64_t budget = std::max(kLeastGpuBudgetBytes, kGpuBudgetBytes / queue_limit_);
  auto renderer = SceneRenderer::create(scene_, patches_, budget);
  if (!renderer) return renderer.error();
  for (;;) {
    std::optional<DrawJob> job = takeJobAtOnce();
    if (!job) {
      LUMIGRID_TRY((*renderer)->finish());
      job = takeJob();
    }
    if (!job) return {};
    LUMIGRID_TRY((*renderer)->renderMany(faceCameras(**renderer, grid_, job->keys), options_,
                                         [this, job = *job](std::size_t i, Rendered rendered) {
                                           take_(job.sequence + i, job.keys[i], std::move(rendered));
                                         }));
  }
}

// Nothing: none is waiting, or drawing has failed.
std::optional<DrawJob> DrawPool::takeJobAtOnce() {
  std::optional<DrawJob> job;
  {
    const std::lock_guard lock(mutex_);
    if (failed_ || queue_.empty()) return job;
    job = std::move(queue_.front());
    queue_.pop_front();
  }
  changed_.notify_all();
  return job;
}

// Nothing: there will be none any more.
std::optional<DrawJob> DrawPool::takeJob() {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return failed_ || finishing_ || !queue_.empty(); });
  }
  return takeJobAtOnce();
}

}  // namespace server
