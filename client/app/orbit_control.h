#pragma once
// Moves the camera by mouse and keys: orbit around a pivot, grab and pan, zoom to the cursor, fly. World coordinates
// are doubles; pixels count from the upper left corner of the view. It knows no window.
//
// Orthographic is a way to show the same camera: at the pivot's depth the picture is as wide as the perspective one, so
// coming nearer magnifies, and switching keeps what is looked at.
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "base/camera.h"
#include "protocol/message.h"

namespace client {

/// The position and direction of a camera. The pivot lies straight ahead.
struct Viewpoint {
  glm::dvec3 position{0.0, 0.0, 1.0};    ///< world
  glm::dvec3 direction{0.0, 0.0, -1.0};  ///< unit, world
  double distance = 1.0;                 ///< to the pivot, world units, above 0
};

struct Ray {
  glm::dvec3 origin{0.0};     ///< world
  glm::dvec3 direction{0.0};  ///< unit, world
};

/// The place on the screen where a point is shown.
struct ScreenPoint {
  double x = 0.0, y = 0.0;  ///< pixels from the upper left corner
  /// Distance along the view axis, world units. At or below 0 the point lies behind the eye, where x and y are valid
  /// only in an orthographic view.
  double depth = 0.0;
};

class OrbitControl {
 public:
  /// Looks at a scene from the side and a little from above, so that all of its hull, or where it has none, of its box,
  /// is in view. With a `start_direction` it looks there.
  void frameScene(const protocol::Welcome& scene);
  void setViewport(int width, int height);  ///< pixels, ≥ 1
  /// Returns the view that frameScene() gave.
  Viewpoint firstViewpoint() const { return first_; }
  /// Returns the viewpoint that shows the whole model from the present direction. The pivot is in its midst.
  Viewpoint framingViewpoint() const;
  /// Returns the viewpoint, moved aside, from which a world point is straight ahead at its distance; it becomes the
  /// pivot.
  Viewpoint viewpointCentredOn(const glm::dvec3& world) const;

  Viewpoint viewpoint() const;
  /// Directions closer to straight up or down than the poles' margin are turned away from the poles.
  void setViewpoint(const Viewpoint& place);
  /// Interpolates two viewpoints at `share` 0 … 1: turns about the up vector, and comes nearer at an even rate.
  Viewpoint between(const Viewpoint& from, const Viewpoint& to, double share) const;

  void setFov(double fov_y) { camera_.fov_y = fov_y; }  ///< radians, in (0, π)
  void setOrthographic(bool on) { orthographic_ = on; }
  bool orthographic() const { return orthographic_; }
  /// Returns the height of an orthographic picture in world units; 0 in perspective.
  double orthoHeight() const;
  double sceneSize() const { return size_; }             ///< the box's diagonal, world units
  const glm::dvec3& boxMin() const { return box_min_; }  ///< world
  const glm::dvec3& boxMax() const { return box_max_; }
  glm::dvec3 boxCenter() const { return 0.5 * (box_min_ + box_max_); }

  ScreenPoint project(const glm::dvec3& world) const;
  /// Returns the ray through the picture at (x, y): from the eye, or in an orthographic view from behind the whole
  /// scene.
  Ray rayAt(double x, double y) const;
  /// Returns the world units that a pixel covers at a world point.
  double pixelSizeAt(const glm::dvec3& world) const;

  const base::ViewCamera& camera() const { return camera_; }
  const glm::dvec3& pivot() const { return pivot_; }

  /// Turns around the pivot; a drag over the whole height of the view is half a turn. The distance to the pivot and its
  /// place on the screen stay. Never tips over the poles.
  void orbit(double dx_px, double dy_px);

  /// Takes hold of the world point shown at (x, y): the surface there, or without one a point as far away as the pivot.
  void grab(double x, double y, const std::optional<glm::dvec3>& surface);
  /// Moves the camera so that the grabbed point is shown at (x, y).
  void dragTo(double x, double y);
  const glm::dvec3& grabbed() const { return grabbed_; }

  /// Comes nearer for `steps` > 0, by a fifth of the way each, to the surface at (x, y), which stays where it is on the
  /// screen.
  void zoom(double steps, double x, double y, const std::optional<glm::dvec3>& surface);

  /// Flies by `distance` pivot distances along the camera's own axes: right, up, forward. In an orthographic view,
  /// forward magnifies.
  void fly(const glm::dvec3& distance);

  /// The picture's axes in the world, unit length.
  glm::dvec3 right() const;
  glm::dvec3 upInView() const;

 private:
  double depthOf(const glm::dvec3& world) const;
  glm::dvec3 pointAt(double x, double y, double depth) const;
  double pixelScale() const;
  glm::dvec3 awayFromPoles(const glm::dvec3& direction) const;
  void move(const glm::dvec3& offset);

  base::ViewCamera camera_;
  glm::dvec3 pivot_{0.0};
  glm::dvec3 up_{0.0, 0.0, 1.0};
  glm::dvec3 grabbed_{0.0};
  double size_ = 1.0;  // diagonal of the box
  glm::dvec3 box_min_{0.0}, box_max_{0.0};
  glm::dvec3 origin_{0.0};       // world, the scene's
  std::vector<glm::vec3> hull_;  // scene-local; not empty once a scene was framed
  bool orthographic_ = false;
  Viewpoint first_;
};

}  // namespace client
