#pragma once
// Adds methods to scenes of tests, built as `lumigrid build` builds them.
#include <filesystem>
#include <string>

#include "base/json/scene_file.h"
#include "lod/hlod/builder/build.h"
#include "lod/pmr/builder/build.h"
#include "tests/support/ply_file.h"
#include "tests/support/scratch_directory.h"

namespace support {

/// Lists a file that lies in the scene's directory as a part of it.
inline base::Result<void> addPart(const std::string& directory, const std::string& file) {
  const std::string path = directory + "/" + file;
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(directory));
  LUMIGRID_ASSIGN_OR_RETURN(const auto hash, base::sha256OfFile(path));
  scene.parts.push_back({file, std::filesystem::file_size(path), hash});
  return base::writeSceneFile(scene, directory + "/scene.json");
}

/// Adds a method's file, which `build(sources, file)` makes of the mesh, to a scene that is there.
template <class Build>
base::Result<void> addMethod(const Mesh& mesh, const std::string& directory, const std::string& file,
                             const Build& build) {
  const ScratchDirectory scratch;
  writePly(scratch / "mesh.ply", mesh);
  const auto built = build({scratch / "mesh.ply"}, directory + "/" + file);
  return built ? addPart(directory, file) : built.error();
}

/// Adds hlod.lgh to a scene that is there.
inline base::Result<void> addNodes(const Mesh& mesh, const std::string& directory) {
  return addMethod(mesh, directory, base::kHlodMethod.file(),
                   [](const std::vector<std::string>& sources, const std::string& path) {
                     return lod::hlod::builder::buildFromFiles(sources, {}, path);
                   });
}

#ifdef LUMIGRID_PMR

/// Adds pmr.lgm, built of the mesh's vertices, to a scene that is there.
inline base::Result<void> addUmbrellas(const Mesh& mesh, const std::string& directory) {
  return addMethod(mesh, directory, base::kUmbrellaMethod.file(),
                   [](const std::vector<std::string>& sources, const std::string& path) {
                     return lod::pmr::builder::buildFromFiles(sources, {}, path);
                   });
}

#else

/// Adds nothing: the build lacks the builder (CMake's option LUMIGRID_PMR).
inline base::Result<void> addUmbrellas(const Mesh&, const std::string&) {
  return {};
}

#endif

}  // namespace support
