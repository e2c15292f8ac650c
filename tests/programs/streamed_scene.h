#pragma once
// Writes a scene of a streamed method's file as a build leaves it, without the builder.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "base/file.h"
#include "base/json/scene_file.h"

namespace programs {

/// Puts the method's file into the folder, in a scene around the origin. `reach`: half the edge of the scene's box.
inline void writeStreamedScene(const std::string& directory, const base::StreamedMethod& method,
                               const base::Bytes& bytes, double reach) {
  std::filesystem::create_directories(directory);
  const std::string file = directory + "/" + method.file();
  EXPECT_TRUE(base::writeFileAtomically(file, bytes));
  base::Scene scene;
  scene.box_min = glm::dvec3(-reach);
  scene.box_max = glm::dvec3(reach);
  scene.has_colors = true;
  scene.light.mode = base::LightMode::kUnlit;
  scene.parameters["methods"] = method.name;
  const auto hash = base::sha256OfFile(file);
  EXPECT_TRUE(hash);
  scene.parts = {{method.file(), bytes.size(), hash ? *hash : ""}};
  EXPECT_TRUE(base::writeSceneFile(scene, directory + "/scene.json"));
}

}  // namespace programs
