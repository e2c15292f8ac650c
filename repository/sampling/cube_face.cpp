#include "repository/sampling/cube_face.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/check.h"

namespace repository {
namespace {

constexpr float kCornerCosine = 0.57735F;  // a corner lies in the direction of (1, 1, 1)

struct Axes {
  glm::vec3 direction;
  glm::vec3 up;
};

// The order is that of Okamoto 2011, figure 5. Faces around the horizon stand upright in a scene whose up is +z; the
// two vertical ones have +y at the top.
const std::array<Axes, 6> kFaces = {{
    {glm::vec3(1.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F)},
    {glm::vec3(-1.0F, 0.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F)},
    {glm::vec3(0.0F, 1.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F)},
    {glm::vec3(0.0F, -1.0F, 0.0F), glm::vec3(0.0F, 0.0F, 1.0F)},
    {glm::vec3(0.0F, 0.0F, 1.0F), glm::vec3(0.0F, 1.0F, 0.0F)},
    {glm::vec3(0.0F, 0.0F, -1.0F), glm::vec3(0.0F, 1.0F, 0.0F)},
}};

}  // namespace

glm::vec3 faceDirection(std::uint32_t d) {
  LUMIGRID_CHECK_LT(d, kFaces.size());
  return kFaces[d].direction;
}

glm::vec3 faceUp(std::uint32_t d) {
  LUMIGRID_CHECK_LT(d, kFaces.size());
  return kFaces[d].up;
}

namespace {

/// The rectangle that a camera sees of the plane at distance 1, in which the face itself is −1 … 1; y points up.
struct FaceWindow {
  float left, right, bottom, top;
};

base::Camera cameraThrough(const Grid& grid, const FaceKey& key, const base::Sphere& scene, const FaceWindow& window,
                           std::uint32_t side) {
  base::Camera camera;
  camera.eye = grid.point(key.x, key.y, key.z);
  camera.width = camera.height = static_cast<int>(side);

  // The axes are signed unit vectors, so the rotation is exact and the six faces meet without a gap.
  const glm::vec3 back = -faceDirection(key.d);
  const glm::vec3 up = faceUp(key.d);
  const glm::vec3 right = glm::cross(up, back);
  camera.eye_from_scene = glm::mat4(glm::transpose(glm::mat3(right, up, back)));
  camera.eye_from_scene[3] = glm::vec4(-(glm::mat3(camera.eye_from_scene) * camera.eye), 1.0F);

  // The tile's part of the frustum begins no nearer than the whole face's: one range of depths serves all.
  const auto [near_plane, far_plane] = base::depthRangeFor(camera.eye, scene, kCornerCosine);
  // A frustum makes x and y scale by exactly 1 at 90° and aspect 1 (section 4.3); a perspective matrix would scale by
  // 1 / tan(float π/4).
  camera.clip_from_eye = glm::frustum(near_plane * window.left, near_plane * window.right, near_plane * window.bottom,
                                      near_plane * window.top, near_plane, far_plane);
  return camera;
}

}  // namespace

base::Camera faceCamera(const Grid& grid, const FaceKey& key, const base::Sphere& scene) {
  if (!grid.isTiled()) return cameraThrough(grid, key, scene, {-1.0F, 1.0F, -1.0F, 1.0F}, grid.face_size);
  const TilePlace place = placeOfTile(key.tile);
  const float core = 2.0F / static_cast<float>(1U << place.depth);
  const float border = core * static_cast<float>(kTileBorder) / static_cast<float>(kTileCore);
  const float left = -1.0F + core * static_cast<float>(place.x);
  const float top = 1.0F - core * static_cast<float>(place.y);
  return cameraThrough(grid, key, scene, {left - border, left + core + border, top - core - border, top + border},
                       kTileSide);
}

base::Camera wholeFaceCamera(const Grid& grid, const FaceKey& key, const base::Sphere& scene) {
  LUMIGRID_CHECK(grid.isTiled());
  const float reach = static_cast<float>(kTileSide) / static_cast<float>(kTileCore);
  return cameraThrough(grid, key, scene, {-reach, reach, -reach, reach}, kTileSide << grid.tile_depth);
}

FaceKey tileOfDirection(const glm::vec3& direction, std::uint32_t depth) {
  FaceKey key;
  key.d = faceOfDirection(direction);
  const glm::vec3 forward = faceDirection(key.d);
  const glm::vec3 up = faceUp(key.d);
  const float distance = glm::dot(direction, forward);
  const float tiles = static_cast<float>(1U << depth);
  const auto placeAlong = [&](float at) {
    const float place = std::clamp(0.5F * (at / distance + 1.0F) * tiles, 0.0F, tiles - 1.0F);
    return static_cast<std::uint32_t>(place);
  };
  key.tile =
      tileAt({depth, placeAlong(glm::dot(direction, glm::cross(forward, up))), placeAlong(-glm::dot(direction, up))});
  return key;
}

std::uint32_t faceOfDirection(const glm::vec3& direction) {
  const glm::vec3 size = glm::abs(direction);
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  return static_cast<std::uint32_t>(2 * axis) + (direction[axis] < 0.0F ? 1U : 0U);
}

}  // namespace repository
