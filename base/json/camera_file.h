#pragma once
// Cameras and recorded camera paths as JSON (docs/formats/camera.md).
//
// A camera:
//   {"position":[x,y,z], "direction":[x,y,z] or "target":[x,y,z], "up":[x,y,z],
//    "fov_y_degrees":45, "width":1280, "height":720, "ortho_height":0}
// A path, whose frames may leave out the members that the path has:
//   {"version":1, "width":…, "height":…, "fov_y_degrees":…, "frames_per_second":60, "jumps":false, "frames":[camera,
//   …]}
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/camera_path.h"
#include "base/error.h"
#include "base/geometry.h"

namespace base {

Result<ViewCamera> readCamera(const std::string& path);
/// Reads a camera from JSON text; `name` begins the error's line.
Result<ViewCamera> parseCamera(const std::string& text, const std::string& name);
/// A path has one frame or more.
Result<CameraPath> readCameraPath(const std::string& path);
std::string formatCameraPath(const CameraPath& path);

/// Places `frames` cameras on a circle around the centre of a box in world coordinates. They look at it from
/// `elevation` radians above the horizon and from `distance` box diagonals away.
std::vector<ViewCamera> orbitPath(const glm::dvec3& box_min, const glm::dvec3& box_max, const glm::dvec3& up,
                                  int frames, double turns, double elevation, double distance, int width, int height);

}  // namespace base
