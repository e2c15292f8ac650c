#pragma once
// The result of a ray cast at the full-resolution surface.
#include <cstdint>
#include <glm/glm.hpp>

namespace client {

struct PickAnswer {
  enum class Kind : std::uint8_t {
    kHit,
    kNone,     ///< the ray meets no surface
    kUnknown,  ///< the ray could not be cast (no server, an error); the approximate point stays
  };
  Kind kind = Kind::kUnknown;
  glm::dvec3 point{0.0};   ///< world
  glm::dvec3 normal{0.0};  ///< unit, or zero
  double accuracy = 0.0;   ///< world units
};

}  // namespace client
