#pragma once
// Threads that draw faces, each with a GL context, a renderer and a cache of patches of its own. With software GL one
// context cannot keep the cores busy: its vertices and triangles are set up by the thread that draws (llvmpipe: 1.4 of
// 4 cores busy, a city scan drawn 1.6 times as fast by four contexts). A GPU gets one: more are not measured.
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/grid.h"
#include "repository/key.h"
#include "server/render/scene_renderer.h"

namespace server {

/// Faces of one grid point, drawn with one cut and one upload.
struct DrawJob {
  std::uint64_t sequence = 0;  ///< number of the first face; the others follow
  std::vector<repository::FaceKey> keys;
};

class DrawPool {
 public:
  /// Called on a drawing thread, for the faces of each job in order; jobs overlap.
  using Take = std::function<void(std::uint64_t sequence, const repository::FaceKey&, Rendered)>;
  /// Called once, on a drawing thread, when drawing has failed; then nothing more is drawn or taken.
  using Fail = std::function<void(const base::Error&)>;

  /// What is referred to must outlive the pool. `threads`: 1 or more.
  DrawPool(const base::Scene& scene, const lod::patch::PatchFile& patches, const repository::Grid& grid,
           const RenderOptions& options, unsigned threads, Take take, Fail fail);
  ~DrawPool();  ///< draws what was submitted
  DrawPool(const DrawPool&) = delete;
  DrawPool& operator=(const DrawPool&) = delete;

  /// Blocks while a job a thread is waiting. A thread without a job delivers what it still has on its way, so whoever
  /// holds back the next job until earlier pictures have come never waits in vain.
  void submit(DrawJob job);
  /// Returns when all is drawn and taken. Nothing may be submitted after it.
  void finish();

  /// Threads to draw with: 1 on a GPU, and 1 where GL is software too, though up to `threads` would be faster there
  /// (draw_pool.cpp says why).
  static base::Result<unsigned> threadsFor(unsigned threads);

 private:
  void work();
  base::Result<void> draw();
  std::optional<DrawJob> takeJob();
  std::optional<DrawJob> takeJobAtOnce();

  const base::Scene& scene_;
  const lod::patch::PatchFile& patches_;
  const repository::Grid& grid_;
  const RenderOptions options_;
  const std::size_t queue_limit_;
  const Take take_;
  const Fail fail_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<DrawJob> queue_;
  bool finishing_ = false;
  bool failed_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace server
