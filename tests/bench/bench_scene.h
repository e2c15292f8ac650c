#pragma once
// Benchmarks read a scene from disk, or build one from a mesh.
#include "base/json/scene_file.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/format.h"
#include "tests/bench/bench.h"

namespace bench {

/// Holds the arguments that benchmarks of faces share.
struct FaceArguments {
  std::string input;         ///< SCENE|MESH
  std::uint32_t grid = 0;    ///< points along the longest side
  std::uint32_t face = 512;  ///< pixels
};
inline constexpr const char* kFaceUsage = "SCENE|MESH [--grid 2..1024] [--face PIXELS]";

inline FaceArguments faceArguments(Arguments& given, std::uint32_t usual_grid) {
  if (given.input().empty()) given.wrong();
  return {given.input(), given.number("--grid", usual_grid, 2U, 1024U), given.number("--face", 512U, 1U, 16384U)};
}

struct OpenScene {
  base::Scene scene;
  lod::patch::PatchFile patches;
};

inline base::Scene buildScene(const std::string& mesh_path, const std::string& patch_path) {
  const auto built = must(lod::patch::builder::buildHierarchyFromFiles({mesh_path}, {}, patch_path));
  base::Scene scene;
  scene.origin = built.origin;
  scene.box_min = built.box_min;
  scene.box_max = built.box_max;
  scene.has_colors = built.has_colors;
  scene.light.mode = scene.has_colors ? base::LightMode::kUnlit : base::LightMode::kSoft;
  return scene;
}

/// Opens a scene's directory; from a mesh it builds the hierarchy into `work`.
inline OpenScene openScene(const std::string& input, const WorkDirectory& work) {
  const bool is_scene = std::filesystem::is_directory(input);
  const std::string patch_path = is_scene ? input + "/patch.lgp" : work / "patch.lgp";
  base::Scene scene = is_scene ? must(base::readScene(input)) : buildScene(input, patch_path);
  return {std::move(scene), must(lod::patch::PatchFile::open(patch_path))};
}

}  // namespace bench
