#pragma once
// Cameras. OpenGL conventions: right-handed, looks along −z, clip depth −1..1.
#include <glm/glm.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <optional>

#include "base/geometry.h"

namespace base {

inline constexpr double kMaxCoordinate = 1e12;  ///< world units, either sign; input beyond it is refused
inline constexpr double kMinFov = 1e-3;         ///< radians; the maximum is π − kMinFov

/// Cuts away the points on the side that `normal` points to: those with dot(normal, p) > offset.
struct SectionPlane {
  glm::dvec3 normal{0.0, 0.0, 1.0};  ///< unit, world
  double offset = 0.0;               ///< along the normal from the world's zero
  friend bool operator==(const SectionPlane&, const SectionPlane&) = default;
};
/// The plane as (normal, offset) relative to the scene's origin. kNoSection cuts nothing.
glm::vec4 sectionInScene(const SectionPlane& plane, const glm::dvec3& scene_origin);
inline constexpr glm::vec4 kNoSection{0.0F, 0.0F, 0.0F, 1.0F};

/// A viewer's camera. World coordinates are the mesh's own (double, e.g. UTM metres). They are made relative to the
/// scene's origin before they become floats.
struct ViewCamera {
  glm::dvec3 position{0.0, 0.0, 1.0};    ///< world
  glm::dvec3 direction{0.0, 0.0, -1.0};  ///< unit, world
  glm::dvec3 up{0.0, 1.0, 0.0};          ///< any vector not parallel to direction
  double fov_y = 0.7853981633974483;     ///< radians, full vertical angle, in (0, π)
  int width = 1280;                      ///< pixels
  int height = 720;                      ///< pixels
  /// Height of an orthographic picture in world units; 0: perspective. An orthographic view shows the whole scene
  /// wherever `position` lies along `direction`.
  double ortho_height = 0.0;
  std::optional<SectionPlane> section;  ///< what it cuts away is not seen

  bool orthographic() const { return ortho_height > 0.0; }
  friend bool operator==(const ViewCamera&, const ViewCamera&) = default;
};

/// A general projective camera in scene-local units, as renderers need it. Off-axis and parallel projections are
/// allowed. In a parallel projection every length counts as being at distance 1 from the viewer, so that the same
/// formulas serve both kinds.
struct Camera {
  glm::mat4 clip_from_eye{1.0F};
  glm::mat4 eye_from_scene{1.0F};
  glm::vec3 eye{0.0F};  ///< scene-local position of the centre of projection; parallel: any point on the axis
  int width = 1;        ///< pixels
  int height = 1;       ///< pixels
  glm::vec4 section = kNoSection;  ///< scene-local: points p with dot(xyz, p) > w are cut away

  glm::mat4 clipFromScene() const { return clip_from_eye * eye_from_scene; }
  bool orthographic() const { return clip_from_eye[2][3] == 0.0F; }
  bool hasSection() const { return glm::vec3(section) != glm::vec3(0.0F); }
  /// Pixels that a length of 1 covers at distance 1 along the axis: height / (2 tan(fov_y / 2)); parallel: anywhere.
  float pixelsPerUnitAtOne() const { return 0.5F * static_cast<float>(height) * clip_from_eye[1][1]; }
  /// The eye as a homogeneous point with w = 1; in a parallel projection the unit direction towards the viewer, w = 0.
  glm::vec4 homogeneousEye() const;
  /// The vector from a point to the viewer; its length is the distance by which scales are divided (1 if parallel).
  glm::vec3 towardsViewer(const glm::vec3& point) const {
    const glm::vec4 from = homogeneousEye();
    return glm::vec3(from) - from.w * point;
  }
  float pixelsPerUnit(const glm::vec3& point) const {
    return pixelsPerUnitAtOne() / glm::max(glm::length(towardsViewer(point)), 1e-12F);
  }
};

/// Whether two cameras make the same picture: equal matrices, size and section.
inline bool sameCamera(const Camera& a, const Camera& b) {
  return a.clip_from_eye == b.clip_from_eye && a.eye_from_scene == b.eye_from_scene && a.width == b.width &&
         a.height == b.height && a.section == b.section;
}

/// Whether both show the same picture but for rounding, as where a path is interpolated or a direction normalized
/// again.
bool showsSameView(const ViewCamera& a, const ViewCamera& b);

/// The renderer's camera for a viewer at `view`, with its section. near and far in scene units, 0 < near < far
/// (orthographic: near < far, of either sign).
Camera cameraFromView(const ViewCamera& view, const glm::dvec3& scene_origin, float near_plane, float far_plane);

/// The distance of a perspective camera's near plane; nothing where its matrix has none.
std::optional<float> nearPlaneOf(const Camera& camera);

/// The distance from `eye` to the nearest point of a sphere that holds the scene, or a 20000th of the distance to the
/// farthest point, if that is more: what projected errors are computed for at least.
float nearestDistance(const glm::vec3& eye, const Sphere& scene);

/// Planes between which lies all of the scene that a picture can show. Near is at least far / 20000, so that 24 depth
/// bits suffice.
struct DepthRange {
  float near_plane;
  float far_plane;
};
/// `corner_cosine`: of the angle between the viewing direction and the ray through a corner of the picture. What lies
/// there is nearer to the eye's plane than to the eye, by that factor.
DepthRange depthRangeFor(const glm::vec3& eye, const Sphere& scene, float corner_cosine);
/// That cosine for a perspective view.
float cornerCosine(const ViewCamera& view);

/// The camera of a view that holds the whole of a scene in this sphere (scene-local) between its near and far planes.
Camera cameraForScene(const ViewCamera& view, const glm::dvec3& scene_origin, const Sphere& scene);

/// A perspective view that replaces an orthographic one where only perspective is supported. It looks along nearly the
/// same rays from far away and has the same footprint at the nearest point of the scene (a sphere in world
/// coordinates). The field of view is at least `min_fov` radians, so views closer than about a thousandth of the scene
/// get a larger footprint. Perspective views are returned unchanged.
ViewCamera perspectiveStandIn(const ViewCamera& view, const glm::dvec3& scene_center, double scene_radius,
                              double min_fov = 1e-3);

/// Screen-space error: pixels = error × height / (2 tan(fov/2) × distance to the sphere's surface). The distance is
/// clamped to `near_plane`, so that the result stays finite inside the sphere.
float projectedError(float error, const glm::vec3& sphere_center, float sphere_radius, const glm::vec3& eye,
                     float pixels_per_unit_at_one, float near_plane);
/// The same for a camera. In a parallel projection pixels = error × scale, independent of the sphere.
float projectedError(float error, const Sphere& sphere, const Camera& camera, float near_plane);

}  // namespace base
