#pragma once
// Scenes of tests, made of meshes in memory as `lumigrid build` makes them of files.
#include <filesystem>
#include <string>

#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/sampling/grid.h"
#include "repository/store.h"
#include "server/bake/bake.h"
#include "tests/support/built_hierarchy.h"
#include "tests/support/built_splats.h"

namespace support {

struct SceneContents {
  bool splats = false;
  std::uint32_t points = 0;  ///< of the grid's longest side; 0: no images
  std::uint32_t face = 256;  ///< pixels along a side of an image
};

inline repository::Grid gridOf(const base::Scene& scene, const SceneContents& contents) {
  return repository::makeGrid(scene.localBox(), contents.points, 0.5F, contents.face);
}

inline base::Result<void> bakeScene(const base::Scene& scene, const std::string& directory,
                                    const SceneContents& contents) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto patches, lod::patch::PatchFile::open(directory + "/patch.lgp"));
  LUMIGRID_ASSIGN_OR_RETURN(const auto store,
                            repository::openLmdbStore(directory + "/images", repository::StoreMode::kWrite));
  server::BakeOptions options;
  options.grid = gridOf(scene, contents);
  const auto baked = server::bake(scene, patches, *store, options, [](const server::BakeProgress&) { return true; });
  return baked ? base::Result<void>() : baked.error();
}

/// Makes a scene in a directory that is there. One of a mesh with colours is unlit.
inline base::Result<base::Scene> makeScene(const Mesh& mesh, const std::string& directory,
                                           const SceneContents& contents = {}) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto built, buildHierarchy(mesh, {}, directory + "/patch.lgp"));
  base::Scene scene;
  scene.origin = built.origin;
  scene.box_min = built.box_min;
  scene.box_max = built.box_max;
  scene.has_colors = built.has_colors;
  scene.light.mode = scene.has_colors ? base::LightMode::kUnlit : base::LightMode::kSoft;
  scene.triangles = mesh.triangleCount();
  std::vector<std::string> files{"patch.lgp"};
  if (contents.splats) {
    if (const auto splats = buildSplats(mesh, {}, directory + "/qsplat.lgq"); !splats) return splats.error();
    files.emplace_back("qsplat.lgq");
  }
  for (const std::string& file : files) {
    const std::string path = directory + "/" + file;
    LUMIGRID_ASSIGN_OR_RETURN(const auto hash, base::sha256OfFile(path));
    scene.parts.push_back({file, std::filesystem::file_size(path), hash});
  }
  LUMIGRID_TRY(base::writeSceneFile(scene, directory + "/scene.json"));
  if (contents.points != 0) LUMIGRID_TRY(bakeScene(scene, directory, contents));
  return scene;
}

}  // namespace support
