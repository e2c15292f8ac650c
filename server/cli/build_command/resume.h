#pragma once
// Decides whether a build goes on with the scene that its output directory holds.
//
// A build in progress keeps scene.json's document as building.json. Its member "parts" lists the finished
// files; a rerun with the same sources and options goes on from there. scene.json appears when everything is in place.
#include <optional>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "server/cli/build_command/options.h"
#include "server/cli/scene_sources.h"

namespace server::cli {

/// The scene in the output directory, when there is one that fits the command.
struct BuildOutput {
  std::optional<base::Scene> scene;  ///< with its hierarchy; nothing for a fresh start
  bool finished = false;             ///< as scene.json; only faults are looked for
  std::string recorded;              ///< the document that this process last wrote
};

/// Files that appear under these names only when they are whole.
inline constexpr const char* kWholeFiles[] = {kPatches.file, kTextureFile, kSplats.file,       kUmbrellas.file,
                                              kHlod.file,    "scene.json", base::kBuildingFile};

/// The scene to go on with or to look over, or nothing for a fresh start; kExists when the output may not be touched.
base::Result<BuildOutput> openOutput(const BuildArguments& a, const SceneSources& sources);

/// Removes the files of a scene, and nothing else that may lie in the directory. Refused while somebody writes images.
base::Result<void> removeScene(const std::string& directory);

/// Writes the scene's document where it has changed.
base::Result<void> recordScene(const BuildArguments& a, BuildOutput& output);
/// The same after a method was built, which the document names from then on: a rerun finds it listed.
base::Result<void> recordMethods(const BuildArguments& a, BuildOutput& output);

bool hasPart(const base::Scene& scene, const std::string& file);
/// Whether the command wants the method's file, and the scene does not list it or it is not there at its listed size.
bool lacksFile(const BuildArguments& a, const base::Scene& scene, const FileMethod& method);

}  // namespace server::cli
