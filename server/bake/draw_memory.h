#pragma once
// How many processes may draw, and with what budgets, so that a bake and all that draws for it stay within a given
// memory (`build --memory`). Estimates from above; draw_memory.cpp says what was measured.
#include <cstdint>

#include "base/error.h"
#include "lod/patch/hierarchy.h"
#include "server/render/scene_renderer.h"

namespace server {

/// What is drawn, as far as memory depends on it.
struct DrawDemand {
  const lod::patch::Hierarchy& hierarchy;
  std::uint32_t face_size = 0;  ///< pixels along a side
  RenderOptions render;
  std::uint32_t batch_faces = 1;   ///< faces per commit
  std::uint64_t window_faces = 1;  ///< encoded faces that may wait for their commit
  std::uint64_t own_bytes = 0;     ///< what this process has besides (a bit for each face of the grid)
  unsigned threads = 1;            ///< cores to keep busy
  bool in_processes = false;       ///< drawn by processes, not by a thread here
  std::uint64_t judge_bytes = 0;   ///< of adaptive sampling: images to judge by; 0: nothing is judged
};

struct DrawLimits {
  unsigned processes = 0;              ///< that draw; 0: a thread of this process does
  unsigned encoders = 1;               ///< threads of this process that encode, where it draws
  std::uint64_t gpu_budget_bytes = 0;  ///< uploaded patches, of each context
};

/// What the images take that a CellJudge of this budget keeps, of a grid: no more than there are.
std::uint64_t judgeBytes(std::uint64_t faces, std::uint32_t face_size, std::uint64_t budget_bytes);

/// Fewer processes first (or encoding threads), then smaller budgets. `memory_bytes`: of all processes together; 0: no
/// limit. The pictures do not depend on it. Errors: kNoSpace, with what is needed at least.
base::Result<DrawLimits> limitDrawing(const DrawDemand& demand, std::uint64_t memory_bytes);

/// The budget of the one context that `tuneScene` draws with, beside `other_bytes`. Errors as limitDrawing.
base::Result<std::uint64_t> limitSampling(const DrawDemand& demand, std::uint64_t other_bytes,
                                          std::uint64_t memory_bytes);

}  // namespace server
