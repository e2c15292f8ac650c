#include "server/cli/build_command/missing.h"

#include <utility>

#include "server/cli/build_command/images.h"
#include "server/cli/build_command/resume.h"
#include "server/cli/scene_sources.h"

namespace server::cli {

base::Result<MissingParts> findMissingParts(const BuildArguments& a) {
  LUMIGRID_ASSIGN_OR_RETURN(auto selection, shardSelectionOf(a));
  const SceneSources sources(a.meshes, false);
  LUMIGRID_TRY(sources.check());
  LUMIGRID_ASSIGN_OR_RETURN(const auto output, openOutput(a, sources));
  MissingParts missing;
  missing.shards = selection.shards;
  if (!output.scene) {
    missing.hierarchy = wants(a, "patch");
    missing.splats = wants(a, "qsplat");
    return missing;
  }

  const base::Scene& scene = *output.scene;
  LUMIGRID_TRY(settleDivision(a, output, selection));
  missing.shards = selection.shards;
  missing.hierarchy = lacksFile(a, scene, kPatches);
  missing.splats = lacksFile(a, scene, kSplats);
  if (!wants(a, "images")) {
    missing.declaration = !missing.files() && !output.finished && !wantsImages(scene);
    return missing;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto images, findMissingImages(a, scene, selection.shards));
  missing.points = !images.points_selected;
  missing.images = std::move(images.shards);
  if (selection.index)
    std::erase_if(missing.images, [&](const auto& one) { return one.shard.index != *selection.index; });
  missing.declaration = !missing.files() && !output.finished && missing.images.empty() && !selection.index;
  return missing;
}

}  // namespace server::cli
