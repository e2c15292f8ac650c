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

/// Adds hlod.lgh to a scene that is there.
inline base::Result<void> addNodes(const Mesh& mesh, const std::string& directory) {
  const ScratchDirectory scratch;
  writePly(scratch / "mesh.ply", mesh);
  const std::string file = base::kHlodMethod.file();
  const auto built = lod::hlod::builder::buildFromFiles({scratch / "mesh.ply"}, {}, directory + "/" + file);
  return built ? addPart(directory, file) : built.error();
}

#ifdef LUMIGRID_PMR

/// Adds pmr.lgm, built of the mesh's vertices, to a scene that is there.
inline base::Result<void> addUmbrellas(const Mesh& mesh, const std::string& directory) {
  const ScratchDirectory scratch;
  writePly(scratch / "mesh.ply", mesh);
  const std::string file = base::kUmbrellaMethod.file();
  const auto built = lod::pmr::builder::buildFromFiles({scratch / "mesh.ply"}, {}, directory + "/" + file);
  return built ? addPart(directory, file) : built.error();
}

#else

/// Adds nothing: the build lacks the builder (CMake's option LUMIGRID_PMR).
inline base::Result<void> addUmbrellas(const Mesh&, const std::string&) {
  return {};
}

#endif

}  // namespace support
