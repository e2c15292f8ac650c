#pragma once
// Cameras. OpenGL conventions: right-handed, looks along −z, clip depth −1..1.
#include <glm/glm.hpp>
#include <glm/gtc/matrix_transform.hpp>

namespace base {

/// A viewer's camera. World coordinates are the mesh's own (double, e.g. UTM metres); what reaches a float is relative
/// to the scene's origin.
struct ViewCamera {
  glm::dvec3 position{0.0, 0.0, 1.0};    ///< world
  glm::dvec3 direction{0.0, 0.0, -1.0};  ///< unit, world
  glm::dvec3 up{0.0, 1.0, 0.0};          ///< any vector not parallel to direction
  double fov_y = 0.7853981633974483;     ///< radians, full vertical angle, in (0, π)
  int width = 1280;                      ///< pixels
  int height = 720;                      ///< pixels
};

/// A general projective camera in scene-local units: what the renderers take. Off-axis projections are allowed.
struct Camera {
  glm::mat4 clip_from_eye{1.0F};
  glm::mat4 eye_from_scene{1.0F};
  glm::vec3 eye{0.0F};  ///< scene-local position of the centre of projection
  int width = 1;        ///< pixels
  int height = 1;       ///< pixels

  glm::mat4 clipFromScene() const { return clip_from_eye * eye_from_scene; }
  /// Pixels that a length of 1 covers at distance 1 along the axis: height / (2 tan(fov_y / 2)).
  float pixelsPerUnitAtOne() const { return 0.5F * static_cast<float>(height) * clip_from_eye[1][1]; }
};

/// The renderer's camera for a viewer at `view`. near and far in scene units, 0 < near < far.
Camera cameraFromView(const ViewCamera& view, const glm::dvec3& scene_origin, float near_plane, float far_plane);

/// Near and far planes that hold a sphere of the given radius around the scene's bounds from `eye`, with near at least
/// far / 20000 so that 24 depth bits suffice.
struct DepthRange {
  float near_plane;
  float far_plane;
};
DepthRange depthRangeFor(const glm::vec3& eye, const glm::vec3& scene_center, float scene_radius);

/// Screen-space error (DESIGN section 4): pixels = error × height / (2 tan(fov/2) × distance to the sphere's surface).
/// The distance is never less than `near_plane`, so that the figure stays finite inside the sphere.
float projectedError(float error, const glm::vec3& sphere_center, float sphere_radius, const glm::vec3& eye,
                     float pixels_per_unit_at_one, float near_plane);

}  // namespace base
