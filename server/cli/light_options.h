#pragma once
// The options that place a light which throws shadows. `lumigrid render --shadows`, `build --light` and `set --light`
// share them.
#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "base/error.h"
#include "base/json/scene_file.h"

namespace server::cli {

/// As given; empty or nothing where not.
struct LightArguments {
  std::string direction, position;  ///< "X,Y,Z"
  std::optional<double> size;       ///< degrees with a direction, scene units with a position
  bool any() const { return !direction.empty() || !position.empty() || size.has_value(); }
};

/// How a command names its shadows, for messages.
struct ShadowWords {
  const char* any;   ///< "--shadows hard or soft"
  const char* soft;  ///< "--shadows soft"
};

void declareLightOptions(CLI::App& command, LightArguments& a, const ShadowWords& words);
/// Names the contradiction, one line; empty where there is none. `mode`: of the light that is chosen.
std::string lightProblem(const LightArguments& a, base::LightMode mode, const ShadowWords& words);
/// Places the light, of which the mode is chosen already. What the arguments do not give stays as it is. They must not
/// contradict themselves. kInvalidInput where soft shadows of a light that is not infinitely far lack its size.
base::Result<void> placeLight(const LightArguments& a, const base::Scene& scene, base::Light& light);

}  // namespace server::cli
