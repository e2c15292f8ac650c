#pragma once
// A scene's light: the shadows that it throws, as lod/ takes them, and the options that place it, which the commands
// `render --shadows`, `build --light` and `set --light` share.
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/hlod/shadow_options.h"

namespace server {

struct SceneShadows {
  lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone;
  lod::hlod::ShadowLight light;  ///< scene-local; its size is 0 unless shadows are soft
};

/// `origin`: the scene's.
SceneShadows shadowsOf(const base::Light& light, const glm::dvec3& origin);
/// The shadows of such a light.
lod::hlod::Shadows shadowsOfMode(base::LightMode mode);

/// How `build` and `set` ask for shadows.
inline constexpr lod::hlod::ShadowWords kLightWords{"--light hard-shadows or soft-shadows", "--light soft-shadows",
                                                    "hlod"};
inline constexpr const char* kPlaceOptions[] = {"light-direction", "light-position", "light-size"};
/// "X,Y,Z", and a size, as the options take them.
std::string vectorText(const glm::dvec3& v);
std::string sizeText(double size);

/// Places the light, of which the mode is chosen already. What the arguments do not give stays as it is. They must not
/// contradict themselves. kInvalidInput where soft shadows of a light that is not infinitely far lack its size.
base::Result<void> placeLight(const lod::hlod::LightArguments& a, const base::Scene& scene, base::Light& light);

}  // namespace server
