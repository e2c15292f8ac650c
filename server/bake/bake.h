#pragma once
// The bake fills the image repository (Okamoto 2011, section 4.3): it renders every face of every sampling point that
// the store lacks, encodes it, and commits the faces in batches. A killed bake loses at most the batch in flight; the
// rerun renders what is missing.
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/jpeg/jpeg.h"
#include "base/json/scene_file.h"
#include "base/resource_limits.h"
#include "base/view_defaults.h"
#include "lod/patch/format.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/shard.h"
#include "repository/sampling/wanted_tiles.h"
#include "repository/store.h"
#include "server/render/scene_renderer.h"

namespace server {

/// How the points that get images are selected (point_selection.h).
struct PointSelection {
  std::uint32_t views = 0;         ///< random views that points are selected for; 0: all points of the grid
  double worth = 0.97;             ///< share of the whole grid's worth to these views that is kept, above 0 to 1
  std::uint64_t budget_bytes = 0;  ///< bytes of all images and masks together; 0: no limit
  bool by_viewers = false;         ///< the views are drawn where viewers were, not anywhere
};

struct BakeOptions {
  repository::Grid grid;
  repository::Shard shard;  ///< only the points of this shard are rendered; the default is all of them
  repository::ImageCodec codec = repository::ImageCodec::kJpeg;
  int quality = base::ViewDefaults::kQuality;                ///< 1..100
  base::Subsampling subsampling = base::Subsampling::k420;   ///< of JPEG
  float tolerance_px = base::ViewDefaults::kExactTolerance;  ///< face pixels
  int supersampling = 2;                                     ///< samples along each side of a face pixel
  /// Faces of up to 512 pixels per commit; of tiled ones, which are larger, as many fewer (facesPerCommit()).
  std::uint32_t batch_faces = 300;
  base::ResourceLimits limits;  ///< memory: of this process and those that draw for it, together
  /// A program (with its arguments) that calls runDrawProcess: where GL is software, several of them draw the faces.
  /// Empty: one thread of this process does. The result is the same.
  std::vector<std::string> draw_command;
  PointSelection selection;
  /// The selected points; needed when selection.views is not 0, and absent otherwise: then all points are sampled.
  std::optional<repository::SampleTree> points;
  /// The selected tiles of these points; all where absent.
  std::optional<repository::WantedTiles> tiles;
};

struct BakeProgress {
  std::uint64_t faces_done = 0, faces_total = 0, faces_skipped = 0;  ///< skipped: already in the store
  double faces_per_second = 0.0;
  std::uint64_t stored_bytes = 0;
};

/// The stored images of one depth; plain faces have depth 0.
struct TileCount {
  std::uint64_t tiles = 0, bytes = 0;
};
using TileCounts = std::array<TileCount, repository::kMaxTileDepth + 1>;

struct BakeSummary {
  std::uint64_t faces_rendered = 0, faces_skipped = 0, faces_empty = 0;
  TileCounts by_depth{};  ///< of the faces that were rendered
  std::uint64_t jpeg_bytes = 0, coverage_bytes = 0;
  double seconds = 0.0;
  std::uint64_t points = 0;  ///< sampling points of this shard
};

/// The cores that a bake keeps busy.
inline unsigned threadsOf(const BakeOptions& options) {
  return options.limits.resolved().threads;
}

/// The faces that a bake commits at a time: they have about as many pixels as batch_faces of 512 pixels a side.
std::uint32_t facesPerCommit(const BakeOptions& options);

/// A grid and options that can be baked: kInvalidInput says what cannot.
base::Result<void> checkBakeOptions(const BakeOptions& options);

/// How a bake draws its faces.
RenderOptions renderOptions(const BakeOptions& options);

/// A store records all that decides the bytes of its faces, so that faces of different builds never mix
/// (docs/formats/repository.md, "Parameters"): JSON with one parameter a line, so that a difference can be told by its
/// line; with options.points and options.tiles as the last lines where only some points and tiles are stored.
std::string storeParameters(const base::Scene& scene, const BakeOptions& options);

/// Writes the parameters to a new store. kExists, with the first line that differs, where the store has others.
base::Result<void> claimStore(repository::Store& store, const std::string& parameters);

/// Renders and stores what the store lacks. `progress` may return false to stop cleanly after the batch in hand
/// (kCancelled). Errors also: kExists where the store was built with other parameters or points; kNoSpace where
/// limits.memory_bytes are too few to draw with.
base::Result<BakeSummary> bake(const base::Scene& scene, const lod::patch::PatchFile& patches, repository::Store& store,
                               const BakeOptions& options, const std::function<bool(const BakeProgress&)>& progress);

}  // namespace server
