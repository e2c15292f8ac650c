#pragma once
// `lumigrid build` makes the files of the methods: the patch hierarchy, the tree of splats, points with their
// umbrellas, and the octree of triangles and points.
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/ingest/shared_source.h"
#include "server/cli/build_command/options.h"
#include "server/cli/build_command/report.h"
#include "server/cli/console.h"
#include "server/cli/scene_sources.h"

namespace server::cli {

/// kNotFound, with a line that asks for them, where the command gives no meshes to build `part` from.
base::Result<void> needMeshes(const BuildArguments& a, const std::string& part);

/// The source, options and report that all methods of one command share.
struct MethodBuilds {
  const BuildArguments& arguments;
  const SceneSources& sources;
  lod::ingest::SharedSource* shared;  ///< null: each method reads the source by itself
  BuildReport& report;
  ProgressLine& line;
};

/// The source for the methods that the command wants and the scene lacks; nothing where it wants only one. `sources`
/// must outlive it.
std::unique_ptr<lod::ingest::SharedSource> shareSource(const BuildArguments& a, const SceneSources& sources,
                                                       const std::function<bool(const FileMethod&)>& lacks);
/// Removes what a run of several methods left of it. `shared`: as shareSource gave it.
void removeSharedSource(const BuildArguments& a, lod::ingest::SharedSource* shared);

/// Builds the hierarchy from the files, describes the scene by it, and lists it as a part. Where something is wrong
/// with the meshes nothing stays behind; what can go on later leaves its work files.
base::Result<void> buildPatches(const MethodBuilds& builds, std::optional<base::Scene>& scene);

/// The same for the tree of splats; it describes the scene only where no hierarchy has.
base::Result<void> buildSplats(const MethodBuilds& builds, std::optional<base::Scene>& scene);
/// The same for points and umbrellas.
base::Result<void> buildUmbrellas(const MethodBuilds& builds, std::optional<base::Scene>& scene);
/// The same for the octree of triangles and points.
base::Result<void> buildHlod(const MethodBuilds& builds, std::optional<base::Scene>& scene);
/// An error where this program was built without the builder of pmr.lgm (CMake's option LUMIGRID_PMR).
base::Result<void> needUmbrellaBuilder();

}  // namespace server::cli
