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

/// The camera of the image under a key: the 90° of a plain face, or a tile's part of them with its border. `scene`
/// holds all that it shows.
base::Camera faceCamera(const Grid& grid, const FaceKey& key, const base::Sphere& scene);

/// The camera of a face that is to be cut into tiles: its finest pixels, and as many around them as the borders of all
/// its tiles show, those of the coarsest kTileBorder · 2^tile_depth. So its sides are kTileSide · 2^tile_depth pixels.
base::Camera wholeFaceCamera(const Grid& grid, const FaceKey& key, const base::Sphere& scene);

/// The tile of this depth in which `direction` (not zero) lies, with its face: all but its point is set.
FaceKey tileOfDirection(const glm::vec3& direction, std::uint32_t depth);

/// The face in which `direction` (not zero) lies.
std::uint32_t faceOfDirection(const glm::vec3& direction);

}  // namespace repository
