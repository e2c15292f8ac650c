#include "server/cli/build_command/images.h"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <utility>

#include "base/file.h"
#include "base/format_text.h"
#include "lod/patch/format.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/shard.h"
#include "repository/store.h"
#include "repository/verify.h"
#include "server/bake/bake.h"
#include "server/bake/point_selection.h"
#include "server/cli/auto_choice.h"
#include "server/cli/commands.h"
#include "server/cli/scene_images.h"
#include "server/cli/shard_choice.h"
#include "server/views/random_views.h"

namespace server::cli {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

std::string imagesOf(const BuildArguments& a) {
  return a.output + "/images";
}

// The points that were selected for --views, for all shards (docs/formats/repository.md).
std::string selectionFileOf(const BuildArguments& a) {
  return imagesOf(a) + "/points.json";
}

repository::Grid gridFor(const BuildArguments& a, const base::Scene& scene) {
  const auto margin = static_cast<float>(a.margin.value_or(usualMargin(scene)));
  const auto grid = repository::makeGrid(scene.localBox(), a.grid.value_or(usualGrid(scene)), margin, a.face);
  return a.tile_depth == 0 ? grid : repository::withTiles(grid, a.tile_depth);
}

base::Subsampling subsamplingOf(const std::string& name) {
  return name == "444" ? base::Subsampling::k444 : name == "422" ? base::Subsampling::k422 : base::Subsampling::k420;
}

// This program, to draw in several processes.
std::vector<std::string> drawCommand() {
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return {};
  return {program.string(), kDrawCommand};
}

// How all shards alike are drawn.
BakeOptions bakeOptions(const BuildArguments& a, const base::Scene& scene, const ImageChoices& choices) {
  BakeOptions options = a.bake;
  options.grid = gridFor(a, scene);
  options.subsampling = subsamplingOf(a.subsampling);
  options.limits = a.limits;
  options.draw_command = drawCommand();
  options.selection.by_viewers = !a.views_from.empty();
  if (choices.selection) {
    options.points = choices.selection->points;
    options.tiles = choices.selection->tiles;
  }
  if (choices.tuned) {
    options.quality = choices.tuned->quality;
    options.subsampling = choices.tuned->subsampling;
  }
  return options;
}

Result<lod::patch::PatchFile> openBuiltPatches(const BuildArguments& a) {
  return lod::patch::PatchFile::open(a.output + "/" + kPatches.file);
}

Result<TuneChoice> chooseQuality(const BuildArguments& a, BuildOutput& output) {
  base::Scene& scene = *output.scene;
  auto stored = storedChoice(scene.parameters);
  if (!stored)
    return base::within(a.output + "/" + (output.finished ? "scene.json" : base::kBuildingFile), stored.error());
  if (*stored) return **stored;
  LUMIGRID_ASSIGN_OR_RETURN(const auto patches, openBuiltPatches(a));
  auto tuned = tuneScene(scene, patches, bakeOptions(a, scene, {}), *a.tune_db);
  if (!tuned) return base::within("--tune", tuned.error());
  storeChoice(*tuned, scene.parameters);
  return *tuned;
}

/// The images that were selected, also where that was for another light: they show as much in this one.
Result<std::optional<Selection>> readSelected(const BuildArguments& a, const base::Scene& scene,
                                              const BakeOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(auto stored, readSelection(selectionFileOf(a), scene, options));
  if (stored || !scene.images_light) return stored;
  base::Scene drawn = scene;
  drawn.light = *scene.images_light;
  return readSelection(selectionFileOf(a), drawn, options);
}

Result<void> keepSelection(const BuildArguments& a, const base::Scene& scene, BakeOptions options,
                           const Selection& selection) {
  options.points = selection.points;
  options.tiles = selection.tiles;
  return writeSelection(selectionFileOf(a), scene, options);
}

/// Whether images are made from chosen points: by use, or in the rooms of an interior.
bool choosesPoints(const BuildArguments& a, const base::Scene& scene) {
  const double usual = usualMargin(scene);
  return a.bake.selection.views != 0 || (scene.interior && a.margin.value_or(usual) == usual);
}

Result<Selection> selectByUse(const BuildArguments& a, const base::Scene& scene, const lod::patch::PatchFile& patches,
                              const BakeOptions& options, ProgressLine& line) {
  std::optional<ViewerPlaces> places;
  if (!a.views_from.empty()) {
    auto read = ViewerPlaces::ofScene(a.views_from, scene.origin);
    if (!read) return base::within("--views-from", read.error());
    places = std::move(*read);
  }
  auto selected = selectImages(scene, patches, options, places ? &*places : nullptr, [&](double done) {
    line.show("sampling points", done);
    return !stopRequested();
  });
  line.finish();
  if (!selected) return base::within("--views", selected.error());
  return selected;
}

Result<Selection> chooseImages(const BuildArguments& a, const base::Scene& scene, const ImageChoices& choices,
                               ProgressLine& line) {
  const BakeOptions options = bakeOptions(a, scene, choices);
  LUMIGRID_ASSIGN_OR_RETURN(auto stored, readSelected(a, scene, options));
  if (stored) {
    if (scene.images_light) LUMIGRID_TRY(keepSelection(a, scene, options, *stored));
    return std::move(*stored);
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto patches, openBuiltPatches(a));
  auto selected = a.bake.selection.views != 0 ? selectByUse(a, scene, patches, options, line)
                                              : selectPointsInRooms(scene, patches, options);
  if (!selected) return selected;
  std::error_code error;
  std::filesystem::create_directories(imagesOf(a), error);
  if (error) return base::systemError(imagesOf(a), "make this directory", error.value());
  LUMIGRID_TRY(keepSelection(a, scene, options, *selected));
  return selected;
}

void add(const BakeSummary& one, std::optional<BakeSummary>& sum) {
  if (!sum) sum.emplace();
  sum->faces_rendered += one.faces_rendered;
  sum->faces_skipped += one.faces_skipped;
  sum->faces_empty += one.faces_empty;
  sum->jpeg_bytes += one.jpeg_bytes;
  sum->coverage_bytes += one.coverage_bytes;
  for (std::size_t depth = 0; depth < one.by_depth.size(); ++depth) {
    sum->by_depth[depth].tiles += one.by_depth[depth].tiles;
    sum->by_depth[depth].bytes += one.by_depth[depth].bytes;
  }
  sum->seconds += one.seconds;
}

std::function<bool(const BakeProgress&)> progressOn(ProgressLine& line, const repository::Shard& shard) {
  const std::string stage =
      shard.count > 1 ? "images " + std::to_string(shard.index) + "/" + std::to_string(shard.count) : "images";
  return [&line, stage](const BakeProgress& p) {
    const auto done = static_cast<double>(p.faces_done + p.faces_skipped);
    line.show(stage, p.faces_total == 0 ? 1.0 : done / static_cast<double>(p.faces_total),
              base::formatText("%.1f images/s, ", p.faces_per_second) + formatBytes(p.stored_bytes));
    return !stopRequested();
  };
}

// Removes what verify would find wrong with a store that is thought to be whole, so that it is rendered again.
Result<void> removeFaults(repository::Store& store, const base::Scene& scene, const BakeOptions& options,
                          repository::RemovalCounts& removed) {
  LUMIGRID_TRY(claimStore(store, storeParameters(scene, options)));  // before faces of other points go
  LUMIGRID_ASSIGN_OR_RETURN(
      const auto one, repository::removeFaulty(store, options.grid, options.shard,
                                               options.points ? &*options.points : nullptr, options.limits.threads));
  removed.damaged += one.damaged;
  removed.orphans += one.orphans;
  return {};
}

Result<void> buildStore(const BuildArguments& a, const BuildOutput& output, BakeOptions& options,
                        const repository::Shard& shard, const std::string& directory, BuildReport& report,
                        ProgressLine& line) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto patches, openBuiltPatches(a));
  LUMIGRID_ASSIGN_OR_RETURN(const auto store, repository::openLmdbStore(directory, repository::StoreMode::kWrite));
  options.shard = shard;
  if (output.finished)
    if (const auto removed = removeFaults(*store, *output.scene, options, report.removed); !removed)
      return base::within(directory, removed.error());
  const auto baked = bake(*output.scene, patches, *store, options, progressOn(line, shard));
  line.finish();
  if (!baked) return base::within(directory, baked.error());
  add(*baked, report.bake);
  return {};
}

}  // namespace

Result<ShardSelection> shardSelectionOf(const BuildArguments& a) {
  const Environment environment = [](const char* name) -> const char* { return std::getenv(name); };
  std::optional<repository::Shard> shard;
  if (a.shard.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(shard, shardFromRanks(environment));
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(shard,
                              a.shard == "auto" ? shardFromLauncher(environment) : repository::parseShard(a.shard));
  }
  if (!shard) return ShardSelection{a.shards, std::nullopt};
  if (a.shards != 0 && a.shards != shard->count)
    return Error{ErrorCode::kInvalidInput, "--shards " + std::to_string(a.shards) + " and a shard of " +
                                               std::to_string(shard->count) + " do not go together"};
  return ShardSelection{shard->count, shard->index};
}

Result<void> settleDivision(const BuildArguments& a, const BuildOutput& output, ShardSelection& selection) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto recorded, shardsOf(*output.scene));
  if (selection.shards == 0 || selection.shards == recorded) {
    selection.shards = recorded;
    return {};
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto layout, repository::layoutOf(imagesOf(a)));
  if (!output.finished && !layout.undivided && layout.shards.empty()) return {};
  const std::string is = recorded == 0 ? "undivided" : "divided into " + std::to_string(recorded) + " shards";
  return Error{ErrorCode::kExists, a.output + ": its images are " + is + ", not into " +
                                       std::to_string(selection.shards) +
                                       "; keep to that, or make the scene anew with --force"};
}

Result<void> removeOrphanStores(const BuildArguments& a, std::uint32_t shards) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto orphans, orphanStores(imagesOf(a), shards));
  for (const std::string& directory : orphans) {
    LUMIGRID_TRY(repository::removeLmdbStore(directory));
    std::fprintf(stderr, "lumigrid: removed %s, which is not of this scene's division\n", directory.c_str());
  }
  return {};
}

Result<void> removeImagesOfOtherLight(const BuildArguments& a, std::uint32_t shards, base::Scene& scene) {
  if (!scene.images_light) return {};
  for (std::uint32_t i = 0; i < std::max(shards, 1U); ++i)
    LUMIGRID_TRY(repository::removeLmdbStore(repository::storeDirectory(imagesOf(a), shards, i)));
  if (!a.quiet)
    std::fprintf(stderr, "light: all images are drawn again, since those there were drawn %s\n",
                 base::nameOf(scene.images_light->mode));
  scene.images_light.reset();
  return {};
}

Result<Trial> chooseMethods(const BuildArguments& a, BuildOutput& output, ProgressLine& line) {
  auto stored = storedTrial(output.scene->parameters);
  if (!stored)
    return base::within(a.output + "/" + (output.finished ? "scene.json" : base::kBuildingFile), stored.error());
  if (*stored) return **stored;
  LUMIGRID_ASSIGN_OR_RETURN(const auto patches, openBuiltPatches(a));
  auto trial = tryMethods(*output.scene, patches, bakeOptions(a, *output.scene, {}), [&](double done) {
    line.show("trial of methods", done);
    return !stopRequested();
  });
  line.finish();
  if (!trial) return base::within("--methods auto", trial.error());
  output.scene->parameters[kAutoParameter] = trialJson(*trial).dump();
  LUMIGRID_TRY(recordScene(a, output));
  return *trial;
}

Result<ImageChoices> makeImageChoices(const BuildArguments& a, BuildOutput& output, ProgressLine& line) {
  ImageChoices choices;
  if (a.tune_db) {
    LUMIGRID_ASSIGN_OR_RETURN(choices.tuned, chooseQuality(a, output));
  }
  if (choosesPoints(a, *output.scene)) {
    LUMIGRID_ASSIGN_OR_RETURN(choices.selection, chooseImages(a, *output.scene, choices, line));
  }
  return choices;
}

Result<void> buildImages(const BuildArguments& a, const BuildOutput& output, const ImageChoices& choices,
                         const ShardSelection& selection, BuildReport& report, ProgressLine& line) {
  BakeOptions options = bakeOptions(a, *output.scene, choices);
  const std::uint32_t count = std::max(selection.shards, 1U);
  std::optional<Error> busy;
  for (std::uint32_t i = selection.index.value_or(0); i < (selection.index ? *selection.index + 1 : count); ++i) {
    const repository::Shard shard{i, count};
    // Where there are more shards than points some are empty and need no store, unless one was asked for.
    if (!selection.index && repository::pointsOf(shard, options.grid).size() == 0) continue;
    const std::string directory = repository::storeDirectory(imagesOf(a), selection.shards, i);
    const auto built = buildStore(a, output, options, shard, directory, report, line);
    if (built) continue;
    if (built.error().code != ErrorCode::kBusy) return built.error();
    busy = built.error();
  }
  return busy ? Result<void>(*busy) : Result<void>();
}

Result<std::vector<repository::ShardGaps>> findMissingImages(const BuildArguments& a, const base::Scene& scene,
                                                             std::uint32_t shards, bool* unselected) {
  ImageChoices choices;
  if (choosesPoints(a, scene)) {
    if (a.tune_db) {
      LUMIGRID_ASSIGN_OR_RETURN(choices.tuned, storedChoice(scene.parameters));
    }
    LUMIGRID_ASSIGN_OR_RETURN(choices.selection, readSelected(a, scene, bakeOptions(a, scene, choices)));
    if (unselected != nullptr) *unselected = !choices.selection.has_value();
  }
  return repository::findMissing(imagesOf(a), shards, gridFor(a, scene),
                                 choices.selection ? &choices.selection->points : nullptr,
                                 scene.images_light.has_value());
}

}  // namespace server::cli
