#pragma once
// The six 90° faces around a sampling point as cameras. d = 0..5 stands for +x −x +y −y +z −z (Okamoto 2011,
// section 4.3).
#include <cstdint>
#include <glm/glm.hpp>

#include "base/camera.h"
#include "repository/sampling/grid.h"

namespace repository {

/// The viewing direction of face d and its up vector: +z for the four horizontal faces, +y for the two vertical ones.
/// Renderer, server and client use this one table, so that a face is drawn and looked up the same way.
glm::vec3 faceDirection(std::uint32_t d);
glm::vec3 faceUp(std::uint32_t d);

/// The 90° camera of a face. `scene` holds all that it shows.
base::Camera faceCamera(const Grid& grid, const FaceKey& key, const base::Sphere& scene);

/// The face in which `direction` (not zero) lies.
std::uint32_t faceOfDirection(const glm::vec3& direction);

}  // namespace repository
