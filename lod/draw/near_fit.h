#pragma once
// Moves a view's near plane out to what is drawn. A depth of 24 bits tells places at a distance d apart that differ by
// d² / (near · 2^24). With near at a 20000th of far, as for an eye within the scene, surfaces that are less than a
// thousandth of the scene apart would show through each other.
#include <span>

#include "base/camera.h"
#include "base/geometry.h"

namespace lod::draw {

/// Takes the bounds of all that is drawn, then gives the camera. All places are scene-local.
class NearFit {
 public:
  explicit NearFit(const base::Camera& camera);

  /// Adds what is drawn in a box. One outside of the picture counts for nothing. Returns false, and adds nothing, where
  /// the box reaches the near plane: then its triangles must be added, or keepNear() called.
  bool add(const base::Aabb& box);
  /// Adds a ball; false as above.
  bool add(const base::Sphere& sphere);
  /// Adds the part of a triangle that lies in the picture.
  void addTriangle(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c);
  /// Something drawn may reach the near plane, which stays where it is then.
  void keepNear() { nearest_ = near_; }
  /// Whether more to add would change nothing.
  bool isKept() const { return nearest_ <= near_; }

  /// The same view, far plane included, with its near plane just before all that was added, and never nearer than it
  /// was. A parallel view stays as it is, since its depths are even.
  base::Camera camera() const;

 private:
  bool keepNearest(float distance);

  const base::Camera camera_;
  const base::Frustum frustum_;
  const glm::vec4 distance_;  ///< times a homogeneous place: its distance along the view's axis
  float corner_cosine_ = 1.0F;
  float near_ = 0.0F;  ///< of the camera as it was
  float nearest_;      ///< distance along the view's axis of the nearest that was added
};

}  // namespace lod::draw
