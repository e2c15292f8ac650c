#pragma once
// Decides how many processes may draw, and with what budgets, so that a bake and all that draws for it stay within a
// given memory (`build --memory`). The estimates are upper bounds; draw_memory.cpp says what was measured.
#include <cstdint>

#include "base/error.h"
#include "lod/patch/hierarchy.h"
#include "server/render/scene_renderer.h"

namespace server {

/// The properties of a bake that its memory depends on.
struct DrawDemand {
  const lod::patch::Hierarchy& hierarchy;
  std::uint32_t face_size = 0;  ///< pixels along a side
  RenderOptions render;
  std::uint32_t batch_faces = 1;   ///< faces per commit
  std::uint64_t window_faces = 1;  ///< encoded faces that may wait for their commit
  std::uint64_t own_bytes = 0;     ///< other memory of this process (a bit for each face of the grid)
  unsigned threads = 1;            ///< cores to keep busy
  bool in_processes = false;       ///< processes draw, not a thread of this one
  std::uint64_t shadow_bytes = 0;  ///< memory of each context for the shadows (PatchShadows::memoryFor)
};

struct DrawLimits {
  unsigned processes = 0;              ///< number that draw; 0: a thread of this process does
  unsigned encoders = 1;               ///< threads that encode where this process draws
  std::uint64_t gpu_budget_bytes = 0;  ///< uploaded patches, of each context
};

/// Takes fewer processes first (or encoding threads), then smaller budgets. `memory_bytes`: of all processes together;
/// 0: no limit. The pictures do not depend on it. Errors: kNoSpace, which says how much is needed at least.
base::Result<DrawLimits> limitDrawing(const DrawDemand& demand, std::uint64_t memory_bytes);

/// The budget of the one context that samples of faces are drawn with (tune.h, point_selection.h), beside
/// `other_bytes`. Errors as limitDrawing.
base::Result<std::uint64_t> limitSampling(const DrawDemand& demand, std::uint64_t other_bytes,
                                          std::uint64_t memory_bytes);

}  // namespace server
