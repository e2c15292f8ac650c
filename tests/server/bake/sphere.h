#pragma once
// Makes a sphere of triangles.
#include <cmath>
#include <numbers>
#include <vector>

#include "tests/server/render/two_level_scene.h"

namespace server::test {

/// Returns the part of a unit sphere with z in from_z … to_z: `rings` rings around z, in two colours; normals outward.
inline std::vector<Triangle> sphere(int rings, float from_z, float to_z) {
  const auto at = [&](int ring, int segment) {
    const float polar = std::acos(from_z + (to_z - from_z) * static_cast<float>(ring) / static_cast<float>(rings));
    const float around = 2.0F * std::numbers::pi_v<float> * static_cast<float>(segment) / static_cast<float>(2 * rings);
    return glm::vec3(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar));
  };
  std::vector<Triangle> triangles;
  for (int ring = 0; ring < rings; ++ring) {
    for (int segment = 0; segment < 2 * rings; ++segment) {
      const glm::u8vec4 color =
          (ring + segment) % 2 == 0 ? glm::u8vec4(220, 80, 60, 255) : glm::u8vec4(60, 90, 200, 255);
      triangles.push_back({at(ring, segment), at(ring, segment + 1), at(ring + 1, segment + 1), color});
      triangles.push_back({at(ring, segment), at(ring + 1, segment + 1), at(ring + 1, segment), color});
    }
  }
  std::erase_if(triangles, [](const Triangle& t) { return glm::length(glm::cross(t.b - t.a, t.c - t.a)) < 1e-3F; });
  return triangles;
}

}  // namespace server::test
