#pragma once
// Computes the meaning of a splat's fields apart from the shaders and the traversal.
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>

#include "base/camera.h"

namespace support {

/// An sRGB colour of 5, 6 and 5 bits; red is at the top.
inline glm::u8vec3 decodeColor(std::uint16_t bits) {
  const std::uint32_t r = bits >> 11;
  const std::uint32_t g = bits >> 5 & 63U;
  const std::uint32_t b = bits & 31U;
  return {static_cast<std::uint8_t>(r << 3 | r >> 2), static_cast<std::uint8_t>(g << 2 | g >> 4),
          static_cast<std::uint8_t>(b << 3 | b >> 2)};
}

/// The projected diameter in pixels as the cut-off means it: as if the sphere were in the picture's middle, where
/// perspective does not stretch it.
inline float projectedDiameter(const glm::vec3& center, float radius, const base::Camera& camera) {
  const glm::mat4 clip = camera.clipFromScene();
  const float depth = clip[0][3] * center.x + clip[1][3] * center.y + clip[2][3] * center.z + clip[3][3];
  return depth > 0.0F ? 2.0F * radius * camera.pixelsPerUnitAtOne() / depth : std::numeric_limits<float>::infinity();
}

}  // namespace support
