#pragma once
// A vertex or point of a surface as the GPU gets it.
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>

namespace lod {

/// 20 bytes.
struct SurfaceVertex {
  glm::vec3 position{0.0F};             ///< scene-local
  std::array<std::int8_t, 4> normal{};  ///< unit vector, 127ths; the last is 0
  glm::u8vec4 color{255};               ///< sRGB, A = 255
};

/// `normal`: unit.
inline SurfaceVertex surfaceVertex(const glm::vec3& position, const glm::vec3& normal, const glm::u8vec3& color) {
  SurfaceVertex vertex;
  vertex.position = position;
  for (int axis = 0; axis < 3; ++axis)
    vertex.normal[static_cast<std::size_t>(axis)] = static_cast<std::int8_t>(std::lround(127.0F * normal[axis]));
  vertex.color = glm::u8vec4(color, 255);
  return vertex;
}

}  // namespace lod
