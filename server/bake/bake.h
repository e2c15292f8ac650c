#pragma once
// Fills the image repository (Okamoto 2011, section 4.3): every face of every grid point that the store lacks is
// rendered, encoded and committed in batches. A killed bake loses at most the batch in flight; the rerun renders what
// is missing.
#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "base/parallel.h"
#include "lod/patch/format.h"
#include "repository/faces/jpeg.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/shard.h"
#include "repository/sampling/tree_text.h"
#include "repository/store.h"
#include "server/render/scene_renderer.h"

namespace server {

struct BakeOptions {
  repository::Grid grid;
  repository::Shard
      shard;         ///< only the points of this shard are rendered; the default is all of them, as target_db needs
  int quality = 85;  ///< JPEG, 1..100
  repository::Subsampling subsampling = repository::Subsampling::k420;
  /// Face pixels. The error behind it bounds the shape alone: at 1 colours are coarser than the pixels already
  /// (docs/lumigraph-tuning.md).
  float tolerance_px = 0.25F;
  int supersampling = 2;            ///< per face pixel side
  std::uint32_t batch_faces = 300;  ///< faces per commit
  unsigned threads = 0;             ///< 0: all cores; the result does not depend on it
  /// Of this process and those that draw for it, together (draw_memory.h); 0: no limit. The result does not depend on
  /// it.
  std::uint64_t memory_bytes = 0;
  /// A program (with its arguments) that calls runDrawProcess: where GL is software, faces are drawn by several of
  /// them. Empty: by one thread of this process. The result is the same.
  std::vector<std::string> draw_command;
  /// PSNR that views blended from a cell's corners must reach, or it is split (adaptive sampling, DESIGN section 5);
  /// `grid` is then the finest. 0: every point of the grid is sampled.
  double target_db = 0.0;
  double least_gain_db = 0.5;  ///< … and only where one more image half-way would gain so much
  /// How much a box of the viewing space is visited (ViewerUse::within); null: all alike. Cells of no use are not
  /// split, and the most used come first.
  std::function<double(const glm::vec3& low, const glm::vec3& high)> use;
  std::uint64_t budget_bytes = 0;  ///< cells are split while the images take about that; 0: no limit
  /// Sampling by use (demand.h): of `grid` only what so many random views would choose; 0: not so. Not with a target.
  std::uint32_t demand_views = 0;
  double demand_worth = 0.97;      ///< the share of the whole grid's worth that is kept, above 0 to 1
  std::uint32_t coarse_cells = 4;  ///< of adaptive sampling: cells along the longest side to begin with, at least
};

struct BakeProgress {
  std::uint64_t faces_done = 0, faces_total = 0, faces_skipped = 0;  ///< skipped: already in the store
  double faces_per_second = 0.0, seconds_left = 0.0;
  std::uint64_t stored_bytes = 0;
  std::uint32_t cell = 0;                           ///< of adaptive sampling: grid steps along the cells at hand
  std::uint64_t cells_judged = 0, cells_total = 0;  ///< of those; total 0: faces are being rendered
};

struct BakeSummary {
  std::uint64_t faces_rendered = 0, faces_skipped = 0, faces_empty = 0;
  std::uint64_t jpeg_bytes = 0, coverage_bytes = 0;
  double seconds = 0.0;
  std::uint64_t points = 0;                    ///< with images, of the grid's
  std::vector<repository::TreeGrowth> growth;  ///< of adaptive sampling, by size of cells
};

/// Whether the points are those of a tree (target_db, demand_views), not all of the grid.
inline bool isAdaptive(const BakeOptions& options) {
  return options.target_db > 0.0 || options.demand_views > 0;
}

/// The cores that a bake keeps busy.
inline unsigned threadsOf(const BakeOptions& options) {
  return options.threads == 0 ? base::coreCount() : options.threads;
}

/// A grid and options that can be baked: kInvalidInput says what cannot.
base::Result<void> checkBakeOptions(const BakeOptions& options);

/// How its faces are drawn.
RenderOptions renderOptions(const BakeOptions& options);

/// `progress` may return false to stop cleanly after the batch in hand (kCancelled). Errors also: kNoSpace where
/// `memory_bytes` are too few to draw with.
base::Result<BakeSummary> bake(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
                               const BakeOptions& options, const std::function<bool(const BakeProgress&)>& progress);

}  // namespace server
