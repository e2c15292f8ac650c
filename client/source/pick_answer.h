#pragma once
// The answer to a full-resolution pick.
#include <cstdint>
#include <glm/glm.hpp>

namespace client {

/// A full-resolution ray cast found this.
struct PickAnswer {
  enum class Kind : std::uint8_t {
    kHit,
    kNone,     ///< the ray meets no surface
    kUnknown,  ///< nobody could say (no server, an error): the approximate point stays
  };
  Kind kind = Kind::kUnknown;
  glm::dvec3 point{0.0};   ///< world
  glm::dvec3 normal{0.0};  ///< unit, or zero
  double accuracy = 0.0;   ///< world units
};

}  // namespace client
