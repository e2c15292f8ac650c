#include "server/bake/draw_thread.h"

#include <optional>
#include <utility>

#include "base/egl/headless.h"
#include "server/bake/face_sample.h"

namespace server {

DrawThread::DrawThread(const base::Scene& scene, const lod::patch::PatchFile& patches, const repository::Grid& grid,
                       const RenderOptions& options, std::uint64_t gpu_budget_bytes, OnRendered on_rendered,
                       OnError on_error)
    : scene_(scene),
      patches_(patches),
      grid_(grid),
      options_(options),
      gpu_budget_bytes_(gpu_budget_bytes),
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

base::Result<void> DrawThread::draw() {
  LUMIGRID_ASSIGN_OR_RETURN(const auto context, base::HeadlessContext::create());
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, SceneRenderer::create(scene_, patches_, gpu_budget_bytes_));
  for (;;) {
    std::optional<DrawJob> job = jobs_.takeJob(false);
    if (!job) {
      LUMIGRID_TRY(renderer->finish());
      job = jobs_.takeJob(true);
    }
    if (!job) return {};
    LUMIGRID_TRY(renderer->renderMany(faceCameras(*renderer, grid_, job->keys), options_,
                                      [this, job = *job](std::size_t i, RenderedPicture rendered) {
                                        on_rendered_(job.sequence + i, job.keys[i], std::move(rendered));
                                      }));
  }
}

}  // namespace server
