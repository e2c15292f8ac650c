#pragma once
// How well stored images show the scene from a place where none was taken: views from there, blended as a client blends
// them, against the true pictures (DESIGN section 5: a cell splits where views blended from its corners miss the
// truth).
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <span>
#include <utility>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "base/picture_error.h"
#include "lod/patch/format.h"
#include "repository/sampling/grid.h"
#include "repository/store.h"
#include "server/render/scene_renderer.h"

namespace server {

struct JudgeOptions {
  RenderOptions truth;    ///< how true pictures are drawn
  int view_size = 256;    ///< pixels along a side of each of the six views
  float proxy_px = 4.0F;  ///< the client's default tolerance, in a view of 720 lines and 45°
  int max_samples = 16;   ///< images blended in a view, the client's default
  std::uint64_t gpu_budget_bytes = std::uint64_t{512} << 20;
};

/// Needs a GL context that is current, from create() to the destructor; one thread.
class CellJudge {
 public:
  /// All must outlive the judge.
  static base::Result<std::unique_ptr<CellJudge>> create(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                                         const repository::Store& store, const repository::Grid& grid,
                                                         const JudgeOptions& options);
  ~CellJudge();

  /// The six views of 90° from `eye`, scene-local, blended from the stored faces of `points`; faces that are not stored
  /// are done without. Errors: those of the store, of a value that cannot be decoded, of drawing.
  base::Result<base::PictureError> judge(SceneRenderer& renderer, const glm::vec3& eye,
                                         std::span<const glm::uvec3> points);
  /// The same twice: first as judge(), then with the six faces of `another` place among the images, as if they were
  /// stored (but not compressed).
  base::Result<std::pair<base::PictureError, base::PictureError>> judgeWith(SceneRenderer& renderer,
                                                                            const glm::vec3& eye,
                                                                            std::span<const glm::uvec3> points,
                                                                            const glm::vec3& another);

 private:
  CellJudge() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
