#pragma once
// A vertex or point of a surface as the GPU gets it.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>

namespace lod {

/// 20 bytes.
struct SurfaceVertex {
  glm::vec3 position{0.0F};             ///< scene-local
  std::array<std::int8_t, 4> normal{};  ///< unit vector, 127ths; the last is 0
  glm::u8vec4 color{255};               ///< sRGB, A = 255
};

}  // namespace lod
