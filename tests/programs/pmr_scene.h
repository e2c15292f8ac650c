#pragma once
// Writes a scene of points and umbrellas as a build leaves it, without the builder.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "tests/support/made_pmr.h"

namespace programs {

/// Puts a torus of points into the folder. Returns what is in its file.
inline support::MadePmr writePmrScene(const std::string& directory) {
  std::filesystem::create_directories(directory);
  support::MadePmr made = support::madePmr();
  const std::string file = directory + "/pmr.lgm";
  EXPECT_TRUE(base::writeFileAtomically(file, made.file));
  base::Scene scene;
  scene.box_min = glm::dvec3(-1.5);
  scene.box_max = glm::dvec3(1.5);
  scene.has_colors = true;
  scene.light.mode = base::LightMode::kUnlit;
  scene.parameters["methods"] = "pmr";
  const auto hash = base::sha256OfFile(file);
  EXPECT_TRUE(hash);
  scene.parts = {{"pmr.lgm", made.file.size(), hash ? *hash : ""}};
  EXPECT_TRUE(base::writeSceneFile(scene, directory + "/scene.json"));
  return made;
}

}  // namespace programs
