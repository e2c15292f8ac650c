#pragma once
// Views from a light that just hold a box of receivers, and which casters lie between (Guthe et al. 2004, section 4.1).
#include <array>
#include <glm/glm.hpp>
#include <limits>
#include <optional>
#include <vector>

#include "base/camera.h"
#include "lod/hlod/seen_box.h"
#include "lod/hlod/shadow_cut.h"

namespace lod::hlod {

/// A view of the light's own. It looks along −z of its axes; depths are distances along them.
class LightView {
 public:
  /// The least window around the box. `axes`: unit columns, the last one towards the light. `place`: that of a light
  /// which isn't infinitely far.
  static LightView parallel(const glm::dmat3& axes, const BoxCorners& box);
  /// The same for a light at a place. None where the box reaches too far aside for one picture.
  static std::optional<LightView> perspective(const glm::dmat3& axes, const glm::dvec3& place, const BoxCorners& box);
  /// The part of a box that is seen in the square picture of 90° along the axes. None where there is none.
  /// `surrounds`: the box contains the light.
  static std::optional<LightView> face(const glm::dmat3& axes, const glm::dvec3& place, const BoxCorners& box,
                                       bool surrounds);

  /// Width and height of the window: scene units, or those of a picture at depth 1.
  glm::dvec2 size() const { return max_ - min_; }
  bool isParallel() const { return is_parallel_; }
  /// Depth of the nearest receivers.
  double nearDepth() const { return near_; }
  /// Makes the window so much wider, scene units, as float32 rounds places. `coordinate`: the largest of the scene.
  void widen(double coordinate);

  /// The largest depth of these places, but not beyond the far plane.
  double largestDepth(const BoxCorners& corners) const;
  /// The least depth at which places of the box may be seen; not below 0 for a light at a place.
  double leastDepth(const base::Aabb& box) const;
  /// Whether places of a convex body may lie in the window.
  bool mayHold(const BoxCorners& corners) const;

  /// The camera. `near_depth`: nothing nearer to the light is shown; it is raised where 24 depth bits need it.
  base::Camera camera(double near_depth, const glm::ivec2& texels) const;

  /// Planes, (unit normal inwards, offset), between which all lies that may come between the light and what the window
  /// holds. `light`: its size widens them.
  std::array<glm::dvec4, 5> casterPlanes(const ShadowLight& light) const;

 private:
  LightView(const glm::dmat3& axes, const glm::dvec3& place, bool is_parallel);
  glm::dvec3 toLight(const glm::dvec3& scene) const { return (scene - place_) * axes_; }
  glm::dvec2 toPicture(const glm::dvec3& local) const {
    return is_parallel_ ? glm::dvec2(local) : glm::dvec2(local) / -local.z;
  }
  void add(const glm::dvec3& local);
  void addPolygon(std::vector<glm::dvec3> polygon);

  glm::dmat3 axes_;
  glm::dvec3 place_;
  bool is_parallel_;
  glm::dvec2 min_{std::numeric_limits<double>::infinity()}, max_{-std::numeric_limits<double>::infinity()};
  double near_ = std::numeric_limits<double>::infinity();  ///< depth of the nearest receiver
  double far_ = -std::numeric_limits<double>::infinity();
};

/// The views in which a light sees a box of receivers: one, or up to six around a light in it or beside it. Pictures
/// follow the axes of the box where they can.
std::vector<LightView> viewsFrom(const ShadowLight& light, const SeenBox& box, const SeenSpace& space);

}  // namespace lod::hlod
