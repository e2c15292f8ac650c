#pragma once
// How mouse and keys move the camera: orbit around a pivot, grab and pan, zoom to the cursor. World coordinates in
// double; pixels from the upper left corner of the view. Nothing here knows a window.
#include <glm/glm.hpp>
#include <optional>

#include "base/camera.h"

namespace client {

class OrbitControl {
 public:
  /// Looks at a box from the side and a little from above, so that all of it is in view.
  void frameBox(const glm::dvec3& box_min, const glm::dvec3& box_max, const glm::dvec3& up);
  void setViewport(int width, int height);  ///< pixels, ≥ 1
  /// Back to the view that frameBox() gave.
  void reset();

  const base::ViewCamera& camera() const { return camera_; }
  const glm::dvec3& pivot() const { return pivot_; }
  void setPivot(const glm::dvec3& world) { pivot_ = world; }

  /// Turns around the pivot; the whole height of the view is half a turn. Distance to the pivot and its place on the
  /// screen stay. Never tips over the poles.
  void orbit(double dx_px, double dy_px);

  /// Takes hold of the world point shown at (x, y): the surface there, or when unknown a point as far as the pivot.
  void grab(double x, double y, const std::optional<glm::dvec3>& surface);
  /// Moves so that the grabbed point is shown at (x, y).
  void dragTo(double x, double y);

  /// `steps` > 0 comes nearer, a fifth of the way each, to the surface at (x, y), which stays where it is on the
  /// screen.
  void zoom(double steps, double x, double y, const std::optional<glm::dvec3>& surface);

  /// Flies by `distance` pivot distances along the camera's own axes: right, up, forward.
  void fly(const glm::dvec3& distance);

 private:
  glm::dvec3 right() const;
  glm::dvec3 upInView() const;
  double depthOf(const glm::dvec3& world) const;
  glm::dvec3 pointAt(double x, double y, double depth) const;
  void move(const glm::dvec3& offset);

  base::ViewCamera camera_;
  glm::dvec3 pivot_{0.0};
  glm::dvec3 up_{0.0, 0.0, 1.0};
  glm::dvec3 grabbed_{0.0};
  double size_ = 1.0;  // of the box, its diagonal
  base::ViewCamera first_camera_;
  glm::dvec3 first_pivot_{0.0};
};

}  // namespace client
