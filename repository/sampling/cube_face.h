#pragma once
// One of the six 90° faces around a sampling point, as a camera. d = 0..5: +x −x +y −y +z −z (Okamoto 2011,
// section 4.3).
#include <cstdint>
#include <glm/glm.hpp>

#include "base/camera.h"
#include "repository/sampling/grid.h"

namespace repository {

/// The viewing direction of face d and its up vector. Up is +z for the horizontal faces and ±y … as cube_face.cpp
/// tables say; the same table serves renderer, server and client, so only its consistency matters.
glm::vec3 faceDirection(std::uint32_t d);
glm::vec3 faceUp(std::uint32_t d);

/// The 90° camera of a face; near and far as for every camera (base::depthRangeFor).
base::Camera faceCamera(const Grid& grid, const FaceKey& key, float near_plane, float far_plane);

/// The face in which `direction` (not zero) lies.
std::uint32_t faceOfDirection(const glm::vec3& direction);

}  // namespace repository
