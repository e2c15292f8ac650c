#pragma once
// A scene of the generated statue with patches and images, for tests of the whole way.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/sampling/grid.h"
#include "repository/store.h"
#include "server/bake/bake.h"
#include "tests/support/built_hierarchy.h"
#include "tests/support/mesh_reader.h"

namespace support {

struct BakedStatue {
  std::string directory;
  base::Scene scene;
  repository::Grid grid;
};

/// Makes the scene in a temporary directory whose name has `name` in it: 40 000 triangles, 6 points a side, faces of
/// 256. The caller removes the directory. Failures are those of the running test.
inline void bakeStatue(const std::string& name, BakedStatue& statue) {
  statue.directory =
      (std::filesystem::temp_directory_path() / ("lumigrid_" + name + "_" + std::to_string(::getpid()))).string();
  std::filesystem::create_directories(statue.directory);
  mesh::generate::SampleOptions sample;
  sample.triangles = 40'000;
  const Mesh mesh = makeSample(sample);
  const auto built = buildHierarchy(mesh, {}, statue.directory + "/patch.lgp");
  ASSERT_TRUE(built) << built.error().message;
  base::Scene& scene = statue.scene;
  scene.origin = built->origin;
  scene.box_min = built->box_min;
  scene.box_max = built->box_max;
  scene.has_colors = true;
  scene.light.mode = base::LightMode::kUnlit;
  scene.triangles = mesh.triangleCount();
  ASSERT_TRUE(base::writeSceneFile(scene, statue.directory + "/scene.json"));

  auto patches = lod::patch::PatchFile::open(statue.directory + "/patch.lgp");
  ASSERT_TRUE(patches) << patches.error().message;
  auto store = repository::openLmdbStore(statue.directory + "/images", repository::StoreMode::kWrite);
  ASSERT_TRUE(store) << store.error().message;
  server::BakeOptions bake;
  bake.grid = statue.grid = repository::makeGrid(scene.localBox(), 6, 0.5F, 256);
  auto baked = server::bake(scene, *patches, **store, bake, [](const server::BakeProgress&) { return true; });
  ASSERT_TRUE(baked) << baked.error().message;
}

}  // namespace support
