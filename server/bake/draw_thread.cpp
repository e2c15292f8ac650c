#include "server/bake/draw_thread.h"

#include <utility>

#include "base/egl/headless.h"
#include "server/bake/face_sample.h"

namespace server {

std::uint32_t drawnDepth(const FaceWork& work, const repository::FaceKey& face) {
  if (work.tiles == nullptr) return work.grid.tile_depth;
  const std::uint32_t finest = repository::placeOfTile(work.tiles->ofFace(face).back()).depth;
  return std::min(finest + 1, work.grid.tile_depth);
}

DrawThread::DrawThread(const FaceWork& work, OnRendered on_rendered, OnError on_error)
    : work_(work),
      on_rendered_(std::move(on_rendered)),
      on_error_(std::move(on_error)),
      thread_([this] { runThread(); }) {}

DrawThread::~DrawThread() {
  finish();
}

void DrawThread::finish() {
  jobs_.finish();
  if (thread_.joinable()) thread_.join();
}

void DrawThread::runThread() {
  const base::Result<void> drawn = draw();
  if (drawn) return;
  jobs_.fail();
  on_error_(drawn.error());
}

std::vector<base::Camera> DrawThread::camerasOf(const SceneRenderer& renderer, const DrawJob& job) const {
  if (work_.tiles == nullptr) return faceCameras(renderer, work_.grid, job.keys);
  std::vector<base::Camera> cameras;
  for (const repository::FaceKey& key : job.keys)
    cameras.push_back(faceCameras(renderer, repository::withTiles(work_.grid, drawnDepth(work_, key)), {key}).front());
  return cameras;
}

base::Result<void> DrawThread::draw() {
  LUMIGRID_ASSIGN_OR_RETURN(const auto context, base::HeadlessContext::create());
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, SceneRenderer::create(work_.scene, work_.patches, work_.gpu_budget_bytes));
  for (;;) {
    std::optional<DrawJob> job = jobs_.takeJob(false);
    if (!job) {
      LUMIGRID_TRY(renderer->finish());
      job = jobs_.takeJob(true);
    }
    if (!job) return {};
    LUMIGRID_TRY(renderer->renderMany(camerasOf(*renderer, *job), work_.render,
                                      [this, job = *job](std::size_t i, RenderedPicture rendered) {
                                        on_rendered_(job.sequence + i, job.keys[i], std::move(rendered));
                                      }));
  }
}

}  // namespace server
