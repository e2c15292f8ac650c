#pragma once
// The options of `lumigrid render` that say which shadows a picture has, and the light that throws them.
#include <CLI/CLI.hpp>
#include <string>

#include "base/json/scene_file.h"
#include "server/cli/light_options.h"

namespace server::cli {

struct ShadowArguments {
  std::string shadows;  ///< none, hard or soft; empty: those of the scene's light
  LightArguments light;
};

void declareShadowOptions(CLI::App& command, ShadowArguments& a);
/// Names the contradiction, one line; empty where there is none. `with_shadows`: the picture's method has shadows.
std::string shadowProblem(const ShadowArguments& a, bool with_shadows);
/// The light of the picture: the scene's where no shadows are asked for. The arguments must not contradict themselves.
/// Errors as placeLight().
base::Result<base::Light> lightOf(const ShadowArguments& a, const base::Scene& scene);

}  // namespace server::cli
