#pragma once
// `lumigrid build` makes the files of the methods: the patch hierarchy, the tree of splats, points with their
// umbrellas, and the octree of triangles and points.
#include <optional>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "server/cli/build_command/options.h"
#include "server/cli/build_command/report.h"
#include "server/cli/console.h"
#include "server/cli/scene_sources.h"

namespace server::cli {

/// kNotFound, with a line that asks for them, where the command gives no meshes to build `part` from.
base::Result<void> needMeshes(const BuildArguments& a, const std::string& part);

/// Builds the hierarchy from the files, describes the scene by it, and lists it as a part. Where something is wrong
/// with the meshes nothing stays behind; what can go on later leaves its work files.
base::Result<void> buildPatches(const BuildArguments& a, const SceneSources& sources, std::optional<base::Scene>& scene,
                                BuildReport& report, ProgressLine& line);

/// The same for the tree of splats; it describes the scene only where no hierarchy has.
base::Result<void> buildSplats(const BuildArguments& a, const SceneSources& sources, std::optional<base::Scene>& scene,
                               BuildReport& report, ProgressLine& line);
/// The same for points and umbrellas.
base::Result<void> buildUmbrellas(const BuildArguments& a, const SceneSources& sources,
                                  std::optional<base::Scene>& scene, BuildReport& report, ProgressLine& line);
/// The same for the octree of triangles and points.
base::Result<void> buildHlod(const BuildArguments& a, const SceneSources& sources, std::optional<base::Scene>& scene,
                             BuildReport& report, ProgressLine& line);
/// An error where this program was built without the builder of pmr.lgm (CMake's option LUMIGRID_PMR).
base::Result<void> needUmbrellaBuilder();

}  // namespace server::cli
