#pragma once
// `lumigrid build` makes the images: it divides them into stores, makes the choices that all stores share, and renders
// the stores that the process was asked for.
#include <cstdint>
#include <optional>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "repository/repository.h"
#include "repository/sampling/sample_tree.h"
#include "server/bake/point_selection.h"
#include "server/bake/tune.h"
#include "server/cli/build_command/options.h"
#include "server/cli/build_command/report.h"
#include "server/cli/build_command/resume.h"
#include "server/cli/console.h"
#include "server/trial/trial.h"

namespace server::cli {

/// Which stores a command is about.
struct ShardSelection {
  std::uint32_t shards = 0;            ///< the division; 0: one undivided store
  std::optional<std::uint32_t> index;  ///< nothing: all of them
};

/// --shard and --shards, or what an MPI launcher says.
base::Result<ShardSelection> shardSelectionOf(const BuildArguments& a);
/// The scene's division is the first that was asked for, and stays while there are images: sets selection.shards to it,
/// or returns kExists where the command asks for another.
base::Result<void> settleDivision(const BuildArguments& a, const BuildOutput& output, ShardSelection& selection);
/// Removes stores of another division, which hold nothing that anybody reads.
base::Result<void> removeOrphanStores(const BuildArguments& a, std::uint32_t shards);

/// Removes the images, and forgets their light, where `lumigrid set --light` has chosen another since they were drawn.
/// Under the scene's lock. kBusy while another process writes them.
base::Result<void> removeImagesOfOtherLight(const BuildArguments& a, std::uint32_t shards, base::Scene& scene);

/// The choices that are made once for all stores of a scene.
struct ImageChoices {
  std::optional<TuneChoice> tuned;     ///< with --tune
  std::optional<Selection> selection;  ///< with --views, and of an interior
};
/// For --methods auto: takes what an earlier run measured, or tries patches and images and keeps what it measured in
/// the scene's parameters. Under the scene's lock.
base::Result<Trial> chooseMethods(const BuildArguments& a, BuildOutput& output, ProgressLine& line);

/// Takes what an earlier run or another shard's has chosen, or chooses and keeps it: --tune in the scene's parameters,
/// --views in images/points.json. Under the scene's lock, so that all shards take the same.
base::Result<ImageChoices> makeImageChoices(const BuildArguments& a, BuildOutput& output, ProgressLine& line);

/// Renders what the selected stores lack. Where the scene is finished, what is damaged or does not belong there is
/// removed first. Stores that other processes write are left to them: kBusy, after all others are done.
base::Result<void> buildImages(const BuildArguments& a, const BuildOutput& output, const ImageChoices& choices,
                               const ShardSelection& selection, BuildReport& report, ProgressLine& line);

/// The faces that the stores lack, and those that are there in another light than the scene's. `unselected`, where
/// given, is told whether points have yet to be selected: then all points of the grid count.
base::Result<std::vector<repository::ShardGaps>> findMissingImages(const BuildArguments& a, const base::Scene& scene,
                                                                   std::uint32_t shards, bool* unselected = nullptr);

}  // namespace server::cli
