#include "server/render/scene_light.h"

#include <numbers>

#include "base/format_text.h"

namespace server {

SceneShadows shadowsOf(const base::Light& light, const glm::dvec3& origin) {
  using lod::hlod::Shadows;
  if (!light.hasShadows()) return {};
  const Shadows shadows = shadowsOfMode(light.mode);
  const double size = shadows == Shadows::kSoft ? light.size : 0.0;
  if (light.position)
    return {shadows, {glm::vec4(glm::vec3(*light.position - origin), 1.0F), static_cast<float>(size)}};
  return {shadows,
          {glm::vec4(glm::normalize(light.direction), 0.0F), static_cast<float>(size * std::numbers::pi / 180.0)}};
}

lod::hlod::Shadows shadowsOfMode(base::LightMode mode) {
  using lod::hlod::Shadows;
  if (mode == base::LightMode::kSoftShadows) return Shadows::kSoft;
  return mode == base::LightMode::kHardShadows ? Shadows::kHard : Shadows::kNone;
}

std::string vectorText(const glm::dvec3& v) {
  return base::formatText("%.17g,%.17g,%.17g", v.x, v.y, v.z);
}

std::string sizeText(double size) {
  return base::formatText("%.17g", size);
}

base::Result<void> placeLight(const lod::hlod::LightArguments& a, const base::Scene& scene, base::Light& light) {
  // Degrees say nothing of a light at a place, nor a length of one that is infinitely far.
  const bool was_near = light.position.has_value();
  if ((was_near ? !a.direction.empty() : !a.position.empty()) || light.mode != base::LightMode::kSoftShadows)
    light.size = 0.0;
  if (!a.direction.empty() || !light.hasShadows()) light.position.reset();
  if (!a.direction.empty()) light.direction = glm::vec3(glm::normalize(lod::hlod::vectorOf(a.direction)));
  if (!a.position.empty()) {
    light.position = lod::hlod::vectorOf(a.position);
    const glm::dvec3 towards = *light.position - 0.5 * (scene.box_min + scene.box_max);
    light.direction = glm::vec3(glm::normalize(glm::length(towards) > 0.0 ? towards : scene.up));
  }
  if (light.mode != base::LightMode::kSoftShadows) return {};
  if (a.size) light.size = *a.size;
  if (light.size == 0.0 && light.position)
    return base::Error{base::ErrorCode::kInvalidInput, "soft shadows of a light at a place need its --light-size"};
  if (light.size == 0.0) light.size = lod::hlod::kSunDegrees;
  return {};
}

}  // namespace server
