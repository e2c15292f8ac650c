#pragma once
// Sampling by use (Okamoto 2011 names it as future work): only those points of a grid get images, and only those of
// their tiles, that a client would be sent. Nobody's view chooses most of a grid's points: for views from anywhere the
// points between viewer and surface are worth most, and one of two neighbours does. The worth of a point is computed
// before any image is rendered, from the server's own choice (plan/point_choice.h) for random views.
#include <functional>
#include <optional>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/sampling/sample_tree.h"
#include "server/bake/bake.h"
#include "server/views/random_views.h"

namespace server {

/// The images that were chosen by use.
struct Selection {
  repository::SampleTree points;
  std::optional<repository::WantedTiles> tiles;  ///< of these points, on a grid of tiles; else absent
};

/// The points for options.selection, as a tree whose leaves are single steps around them; all other points are left
/// out. Points are dropped, least used first, as long as the choice for the views is worth at least selection.worth of
/// what it is worth with the whole grid, and further until the images fit into selection.budget_bytes (estimated;
/// GL draws with options' quality then). On a grid of tiles those are kept that gain the same share of what all tiles
/// of these points gain to the views, or fewer for the budget, and points that have any (tile_selection.h). `places`:
/// where viewers were, for selection.by_viewers, else null.
///
/// The same input gives the same tree on any number of threads; other processors may round otherwise, so processes that
/// share a scene take one selection (readSelection). `progress` is told a share of 0..1, which may stand still, and
/// returns false to stop (kCancelled). Errors: kInvalidInput where the model leaves no room for a view, no view sees
/// it, or the budget does not hold the images of one point; those of reading patches and of drawing.
base::Result<Selection> selectImages(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                     const BakeOptions& options, const ViewerPlaces* places = nullptr,
                                     const std::function<bool(double done)>& progress = nullptr);

/// The points of options.grid that see the rooms of an interior, as a tree of single steps; all points where none does.
/// Errors: those of reading patches.
base::Result<Selection> selectPointsInRooms(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                            const BakeOptions& options);

/// Keeps options.points and options.tiles in a file, with the parameters that they were selected for.
base::Result<void> writeSelection(const std::string& path, const base::Scene& scene, const BakeOptions& options);
/// The points and tiles in such a file; nothing where it is not there or was written for other parameters.
/// options.points and options.tiles do not matter.
base::Result<std::optional<Selection>> readSelection(const std::string& path, const base::Scene& scene,
                                                     const BakeOptions& options);

}  // namespace server
