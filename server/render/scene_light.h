#pragma once
// The shadows that a scene's light throws, as lod/ takes them.
#include <glm/glm.hpp>
#include <numbers>

#include "base/json/scene_file.h"
#include "lod/hlod/shadow_options.h"

namespace server {

struct SceneShadows {
  lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone;
  lod::hlod::ShadowLight light;  ///< scene-local; its size is 0 unless shadows are soft
};

/// `origin`: the scene's.
inline SceneShadows shadowsOf(const base::Light& light, const glm::dvec3& origin) {
  using lod::hlod::Shadows;
  if (!light.hasShadows()) return {};
  const bool is_soft = light.mode == base::LightMode::kSoftShadows;
  const double size = is_soft ? light.size : 0.0;
  const Shadows shadows = is_soft ? Shadows::kSoft : Shadows::kHard;
  if (light.position)
    return {shadows, {glm::vec4(glm::vec3(*light.position - origin), 1.0F), static_cast<float>(size)}};
  return {shadows,
          {glm::vec4(glm::normalize(light.direction), 0.0F), static_cast<float>(size * std::numbers::pi / 180.0)}};
}

}  // namespace server
