#pragma once
// The part of Welcome that scene.json alone decides.
#include <string>

#include "base/json/scene_file.h"
#include "protocol/message.h"

namespace protocol {

/// Hierarchy and grid are left as they are by default. `name`: the scene's where it has no title.
inline Welcome welcomeOf(const base::Scene& scene, const std::string& name) {
  const base::Aabb box = scene.localBox();
  Welcome welcome;
  welcome.scene_name = scene.title.empty() ? name : scene.title;
  welcome.units = scene.units == "unknown" ? "" : scene.units;
  welcome.origin = scene.origin;
  welcome.box_min = box.min;
  welcome.box_max = box.max;
  welcome.up = glm::vec3(scene.up);
  if (scene.start_direction) welcome.start_direction = glm::vec3(*scene.start_direction);
  welcome.start_view = scene.start_view;
  welcome.unlit = scene.light.mode == base::LightMode::kUnlit;
  welcome.shadows = scene.light.hasShadows();
  welcome.light_direction = scene.light.direction;
  welcome.attribution = scene.attribution;
  welcome.background = scene.background;
  welcome.north = glm::vec3(northOf(scene));
  static_assert(base::kMaxHull <= kMaxHull);
  for (const glm::dvec3& point : scene.hull) welcome.hull.emplace_back(point - scene.origin);
  return welcome;
}

}  // namespace protocol
