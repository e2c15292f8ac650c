#pragma once
// Adaptive sampling (DESIGN section 5; Okamoto 2011, future work: "sampling by geometric complexity"): from a few large
// cells on, a cell is split where a held-out view inside it, blended from the images at its corners as a client blends
// them, misses the truth by more than the target.
#include <functional>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/sampling/sample_tree.h"
#include "repository/store.h"
#include "server/bake/bake.h"
#include "server/render/scene_renderer.h"

namespace server {

struct AdaptiveWork {
  const base::Scene& scene;
  const lod::patch::PatchFile& patches;
  repository::Store& store;
  const BakeOptions& options;
  SceneRenderer& renderer;
  std::string parameters;  ///< the store's meta text without a tree
  /// Renders and stores what is missing at these points, durable on return; gives those that see nothing.
  std::function<base::Result<std::vector<glm::uvec3>>(const std::vector<glm::uvec3>&)> render;
  std::function<std::uint64_t()> stored_bytes;
  std::function<bool(const BakeProgress&)> progress;  ///< false stops
};

/// Largest power of two, in grid steps, of which at least `cells` lie along the grid's longest side (1 at least).
std::uint32_t coarseCellSize(const repository::Grid& grid, std::uint32_t cells);

/// Goes on with the tree that the store holds, or begins one, until every cell is judged and every point rendered. The
/// tree is stored again and again on the way. Points that the model encloses or that see nothing are left out.
base::Result<std::vector<repository::TreeGrowth>> sampleAdaptively(AdaptiveWork& work, repository::SampleTree& tree);

}  // namespace server
