#pragma once
// The options of `lumigrid render` that say which shadows a picture has, and the light that throws them.
#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/json/scene_file.h"
#include "server/render/hlod_scene.h"

namespace server::cli {

struct ShadowArguments {
  std::string shadows = "none";
  std::vector<double> direction, position;  ///< empty, or three numbers
  std::optional<double> size;               ///< degrees with a direction, scene units with a position
};

void declareShadowOptions(CLI::App& command, ShadowArguments& a);
/// Names the contradiction, one line; empty where there is none. `with_shadows`: the picture's method has shadows.
std::string shadowProblem(const ShadowArguments& a, bool with_shadows);
/// Sets the shadows and their light. The scene's light shines from its direction where none is given. The arguments
/// must not contradict themselves.
void setShadows(const ShadowArguments& a, const base::Scene& scene, HlodOptions& options);

}  // namespace server::cli
