#pragma once
// Fills the image repository (Okamoto 2011, section 4.3): every face of every grid point that the store lacks is
// rendered, encoded and committed in batches. A killed bake loses at most the batch in flight; the rerun renders what
// is missing.
#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/grid.h"
#include "repository/jpeg.h"
#include "repository/shard.h"
#include "repository/store.h"

namespace server {

struct BakeOptions {
  repository::Grid grid;
  repository::Shard shard;  ///< only the points of this shard are rendered; the default is all of them
  int quality = 85;         ///< JPEG, 1..100
  repository::Subsampling subsampling = repository::Subsampling::k420;
  /// Face pixels. The error behind it bounds the shape alone: at 1 colours are coarser than the pixels already
  /// (docs/lumigraph-tuning.md).
  float tolerance_px = 0.25F;
  int supersampling = 2;            ///< per face pixel side
  std::uint32_t batch_faces = 300;  ///< faces per commit
  unsigned threads = 0;             ///< 0: all cores
};

struct BakeProgress {
  std::uint64_t faces_done = 0, faces_total = 0, faces_skipped = 0;  ///< skipped: already in the store
  double faces_per_second = 0.0, seconds_left = 0.0;
  std::uint64_t stored_bytes = 0;
};

struct BakeSummary {
  std::uint64_t faces_rendered = 0, faces_skipped = 0, faces_empty = 0;
  std::uint64_t jpeg_bytes = 0, coverage_bytes = 0;
  double seconds = 0.0;
};

/// `progress` may return false to stop cleanly after the batch in hand (kCancelled).
base::Result<BakeSummary> bake(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
                               const BakeOptions& options, const std::function<bool(const BakeProgress&)>& progress);

}  // namespace server
