#pragma once
// The view and its modes: everything that a permalink or a bookmark holds.
#include <glm/glm.hpp>
#include <optional>

#include "base/camera.h"
#include "client/source/method.h"
#include "lod/hlod/shadow_options.h"

namespace client {

/// A plane perpendicular to a world axis; the model on one side of it is not drawn.
struct Section {
  bool on = false;
  int axis = 2;            ///< 0, 1, 2: x, y, z
  bool keep_below = true;  ///< keeps coordinates below `offset` along the axis, else those above it
  double offset = 0.0;     ///< world coordinate along the axis
  std::optional<base::SectionPlane> plane() const;  ///< nothing where it is off
  friend bool operator==(const Section&, const Section&) = default;
};

/// A light of the viewer's own, in the world's axes.
struct OwnLight {
  bool on = false;
  double heading = 0.0;  ///< degrees, −180 to 180: from x towards y
  double height = 90.0;  ///< degrees above the plane of x and y, −90 to 90
  glm::dvec3 direction() const;
  /// One that is on. `direction`: not 0.
  static OwnLight towards(const glm::dvec3& direction);
  friend bool operator==(const OwnLight&, const OwnLight&) = default;
};

struct ViewState {
  glm::dvec3 position{0.0, 0.0, 1.0};    ///< world
  glm::dvec3 direction{0.0, 0.0, -1.0};  ///< unit, world
  /// Distance of the pivot along the direction, world units, above 0; 0: the eye stays where it is.
  double pivot_distance = 1.0;
  double fov_y = 0.7853981633974483;  ///< radians, full vertical angle
  Method method = Method::kLumigraph;
  bool statistics = false;
  bool colors_by_resolution = false;
  bool orthographic = false;  ///< at the pivot's depth it shows what the perspective view shows there
  Section section;
  OwnLight light;
  lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone;  ///< with Method::kHlod
  friend bool operator==(const ViewState&, const ViewState&) = default;
};

}  // namespace client
