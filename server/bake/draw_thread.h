#pragma once
// One thread of a process draws faces, with a GL context, a renderer and a cache of patches of its own. More were not
// measured on a GPU, and Mesa's llvmpipe (22.3) crashes in its own code about twice in a hundred bakes when several
// contexts draw at a time. Several processes draw as well as several contexts would (draw_processes.h).
#include <cstdint>
#include <functional>
#include <thread>
#include <utility>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "base/view_defaults.h"
#include "lod/patch/format.h"
#include "repository/faces/jpeg.h"
#include "repository/sampling/grid.h"
#include "server/bake/job_slot.h"
#include "server/render/scene_renderer.h"

namespace server {

/// The order of a bake. Scene and patches outlive whoever draws it.
struct FaceWork {
  const base::Scene& scene;
  const lod::patch::PatchFile& patches;
  repository::Grid grid;
  RenderOptions render;
  int quality = base::ViewDefaults::kQuality;  ///< JPEG, 1..100
  repository::Subsampling subsampling = repository::Subsampling::k420;
  std::uint64_t gpu_budget_bytes = std::uint64_t{2} << 30;  ///< uploaded patches, of each context
};

class DrawThread {
 public:
  /// Called on the thread, for the faces of each job in order.
  using OnRendered = std::function<void(std::uint64_t sequence, const repository::FaceKey&, RenderedPicture)>;
  /// Called once, on the thread, when drawing has failed; then nothing more is drawn or delivered.
  using OnError = std::function<void(const base::Error&)>;

  /// Encoding is not its business.
  DrawThread(const FaceWork& work, OnRendered on_rendered, OnError on_error);
  ~DrawThread();  ///< draws what was submitted
  DrawThread(const DrawThread&) = delete;
  DrawThread& operator=(const DrawThread&) = delete;

  /// Blocks while a job is waiting. Without a job the thread delivers the pictures that are still on their way, so a
  /// caller that holds back the next job until earlier pictures have come never waits in vain.
  void submit(DrawJob job) { jobs_.submit(std::move(job)); }
  /// Returns when all is drawn and delivered. Nothing may be submitted after it.
  void finish();

 private:
  void runThread();
  base::Result<void> draw();

  const FaceWork work_;
  const OnRendered on_rendered_;
  const OnError on_error_;
  JobSlot jobs_;
  std::thread thread_;  // last: it uses the others
};

}  // namespace server
