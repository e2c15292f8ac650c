#pragma once
// Points and umbrellas for scenes of tests, where the build has their builder (CMake's option LUMIGRID_PMR).
#include <filesystem>
#include <string>

#include "base/json/scene_file.h"
#include "lod/pmr/builder/build.h"
#include "tests/support/ply_file.h"
#include "tests/support/scratch_directory.h"

namespace support {

#ifdef LUMIGRID_PMR

/// Adds pmr.lgm, built of the mesh's vertices, to a scene that is there.
inline base::Result<void> addUmbrellas(const Mesh& mesh, const std::string& directory) {
  const ScratchDirectory scratch;
  writePly(scratch / "mesh.ply", mesh);
  const std::string file = base::kUmbrellaMethod.file();
  const std::string path = directory + "/" + file;
  if (const auto built = lod::pmr::builder::buildFromFiles({scratch / "mesh.ply"}, {}, path); !built)
    return built.error();
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(directory));
  LUMIGRID_ASSIGN_OR_RETURN(const auto hash, base::sha256OfFile(path));
  scene.parts.push_back({file, std::filesystem::file_size(path), hash});
  return base::writeSceneFile(scene, directory + "/scene.json");
}

#else

/// Adds nothing.
inline base::Result<void> addUmbrellas(const Mesh&, const std::string&) {
  return {};
}

#endif

}  // namespace support
