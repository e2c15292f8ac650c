#include "server/bake/draw_thread.h"

#include <utility>

#include "base/egl/headless.h"
#include "server/bake/face_sample.h"

namespace server {

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
    LUMIGRID_TRY(renderer->renderMany(faceCameras(*renderer, work_.grid, job->keys), work_.render,
                                      [this, job = *job](std::size_t i, RenderedPicture rendered) {
                                        on_rendered_(job.sequence + i, job.keys[i], std::move(rendered));
                                      }));
  }
}

}  // namespace server
