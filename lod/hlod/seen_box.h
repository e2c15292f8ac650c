#pragma once
// The part of a view in which some of its nodes are seen: a box along the view's own axes (Guthe et al. 2004,
// section 4.1).
#include <array>
#include <glm/glm.hpp>
#include <limits>

#include "lod/hlod/traverse.h"

namespace lod::hlod {

/// A box in the coordinates of a view's eye: x to the right, y upwards, and −z the depth.
struct SeenBox {
  glm::dvec3 min{std::numeric_limits<double>::infinity()};
  glm::dvec3 max{-std::numeric_limits<double>::infinity()};

  bool empty() const { return !(min.x <= max.x && min.y <= max.y && min.z <= max.z); }
  void add(const glm::dvec3& p) { min = glm::min(min, p), max = glm::max(max, p); }
  void add(const SeenBox& box) { min = glm::min(min, box.min), max = glm::max(max, box.max); }
  SeenBox within(const SeenBox& box) const { return {glm::max(min, box.min), glm::min(max, box.max)}; }
  bool contains(const glm::dvec3& p) const {
    return glm::all(glm::lessThanEqual(min, p)) && glm::all(glm::lessThanEqual(p, max));
  }
  /// Corner 0 … 7: bit k says whether coordinate k is the largest.
  glm::dvec3 corner(int i) const {
    return {(i & 1) != 0 ? max.x : min.x, (i & 2) != 0 ? max.y : min.y, (i & 4) != 0 ? max.z : min.z};
  }
};
using BoxCorners = std::array<glm::dvec3, 8>;

/// The corners of a box in any order, in double precision.
BoxCorners boxCorners(const base::Aabb& box);

/// A view's frustum, and where boxes lie in it.
class SeenSpace {
 public:
  /// The frustum is that of the request's tile where it has one.
  explicit SeenSpace(const TraverseRequest& request);

  /// Whether the request's camera has numbers throughout.
  bool isFinite() const;
  /// Holds the part of the box that lies in the frustum; empty where there is none.
  SeenBox seenPart(const base::Aabb& box) const;
  /// The part of a box along the view's axes that lies between the sides of the frustum, or a little more.
  SeenBox betweenSides(SeenBox box) const;
  /// The most pixels per scene unit that the view shows at any place of the box, in any direction.
  double largestScale(const SeenBox& box) const;
  glm::dvec3 toEye(const glm::dvec3& scene) const { return scene * axes_ + shift_; }
  glm::dvec3 toScene(const glm::dvec3& eye) const { return scene_from_eye_ * (eye - shift_); }
  BoxCorners toScene(const SeenBox& box) const;
  /// The view's axes as unit columns, scene-local.
  const glm::dmat3& axes() const { return axes_; }
  bool isParallel() const { return clip_[2][3] == 0.0; }

 private:
  const glm::dmat4 clip_;
  const glm::dmat3 axes_, scene_from_eye_;
  const glm::dvec3 shift_;
  const double pixels_at_one_;
  double largest_secant_ = 1.0;
};

}  // namespace lod::hlod
