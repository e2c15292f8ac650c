#pragma once
// Draws faces and encodes them. Two ways, of which a bake takes one: with one GL context on a thread of this process,
// or with a context in each of several processes (draw_processes.h).
#include <cstdint>
#include <functional>
#include <memory>

#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"
#include "server/bake/draw_thread.h"
#include "server/bake/face_encoder.h"
#include "server/render/scene_renderer.h"

namespace server {

/// What is drawn. What is referred to outlives whoever draws.
struct FaceWork {
  const base::Scene& scene;
  const lod::patch::PatchFile& patches;
  repository::Grid grid;
  RenderOptions render;
  int quality = 85;  ///< JPEG, 1..100
  repository::Subsampling subsampling = repository::Subsampling::k420;
  std::uint64_t gpu_budget_bytes = std::uint64_t{2} << 30;  ///< uploaded patches, of each context
};

class FaceMaker {
 public:
  /// Called from any thread, for the faces of all jobs in any order.
  using Take = std::function<void(std::uint64_t sequence, const repository::FaceKey&, EncodedFace)>;
  /// Called once at least when something has failed, from any thread; faces may be missing then.
  using Fail = std::function<void(const base::Error&)>;

  virtual ~FaceMaker() = default;  ///< makes what was submitted
  /// Blocks while enough jobs are waiting. Whoever holds back the next job until earlier faces have come never waits in
  /// vain.
  virtual void submit(DrawJob job) = 0;
  /// Returns when all is made and taken. Nothing may be submitted after it.
  virtual void finish() = 0;
};

using Encode =
    std::function<base::Result<EncodedFace>(const base::Image& rgba, int quality, repository::Subsampling subsampling)>;

/// With a DrawThread, and so many threads that encode.
std::unique_ptr<FaceMaker> makeFacesHere(const FaceWork& work, unsigned threads, FaceMaker::Take take,
                                         FaceMaker::Fail fail, Encode encode = encodeFace);

}  // namespace server
