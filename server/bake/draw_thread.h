#pragma once
// One thread of a process draws faces, with a GL context, a renderer and a cache of patches of its own. More were not
// measured on a GPU, and Mesa's llvmpipe (22.3) crashes in its own code about twice in a hundred bakes when several
// contexts draw at a time. Several processes draw as well as several contexts would (draw_processes.h).
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/jpeg/jpeg.h"
#include "base/json/scene_file.h"
#include "base/view_defaults.h"
#include "lod/patch/format.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"
#include "repository/sampling/wanted_tiles.h"
#include "server/render/scene_renderer.h"

namespace server {

/// Faces of one grid point, which are drawn with one cut and one upload.
struct DrawJob {
  std::uint64_t sequence = 0;  ///< number of the first face; the others follow
  std::vector<repository::FaceKey> keys;
};

/// The one job that waits between the thread that deals jobs out and those that draw them. Safe from any thread.
class JobSlot {
 public:
  /// Blocks while a job is waiting. After fail() the job is dropped.
  void submit(DrawJob job) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return failed_ || !job_; });
    if (failed_) return;
    job_ = std::move(job);
    changed_.notify_all();
  }
  /// Takes the job that is waiting, if there is one. With `wait` it waits for one: nothing when there will be none any
  /// more.
  std::optional<DrawJob> takeJob(bool wait) {
    std::unique_lock lock(mutex_);
    if (wait) changed_.wait(lock, [&] { return finishing_ || failed_ || job_; });
    std::optional<DrawJob> job = std::exchange(job_, std::nullopt);
    if (job) changed_.notify_all();
    return job;
  }
  /// Nothing is submitted after it.
  void finish() {
    const std::lock_guard lock(mutex_);
    finishing_ = true;
    changed_.notify_all();
  }
  /// Drops the job that is waiting and all that follow. False when that was so already.
  bool fail() {
    const std::lock_guard lock(mutex_);
    if (std::exchange(failed_, true)) return false;
    job_.reset();
    changed_.notify_all();
    return true;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<DrawJob> job_;
  bool finishing_ = false;
  bool failed_ = false;
};

/// The order of a bake. Scene and patches outlive whoever draws it.
struct FaceWork {
  const base::Scene& scene;
  const lod::patch::PatchFile& patches;
  repository::Grid grid;
  RenderOptions render;
  int quality = base::ViewDefaults::kQuality;               ///< 1..100
  base::Subsampling subsampling = base::Subsampling::k420;  ///< of JPEG
  std::uint64_t gpu_budget_bytes = std::uint64_t{2} << 30;  ///< uploaded patches, of each context
  repository::ImageCodec codec = repository::ImageCodec::kJpeg;
  const repository::WantedTiles* tiles = nullptr;  ///< outlive whoever draws, too; null: all are stored
};

/// The depth at which a face of tiles is drawn: one finer than its finest wanted tile, so that as many samples as of
/// any make a pixel of that.
std::uint32_t drawnDepth(const FaceWork& work, const repository::FaceKey& face);

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
  std::vector<base::Camera> camerasOf(const SceneRenderer& renderer, const DrawJob& job) const;

  const FaceWork work_;
  const OnRendered on_rendered_;
  const OnError on_error_;
  JobSlot jobs_;
  std::thread thread_;  // last: it uses the others
};

}  // namespace server
