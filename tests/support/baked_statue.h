#pragma once
// A scene of the generated statue with patches and images, for tests of the whole way.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "tests/support/made_scene.h"
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
  const SceneContents contents{.points = 6};
  const auto scene = makeScene(makeSample(sample), statue.directory, contents);
  ASSERT_TRUE(scene) << scene.error().message;
  statue.scene = *scene;
  statue.grid = gridOf(*scene, contents);
}

}  // namespace support
