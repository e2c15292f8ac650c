#pragma once
// Rounds coordinates outward to lattice points, for boxes that are stored as such.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>

#include "lod/lattice.h"

namespace lod {

/// The largest of the lattice coordinates 0 … end − 1 on an axis whose position is at most `value`, a scene-local
/// coordinate; 0 where there is none.
inline std::int32_t latticeBelow(double value, const Lattice& lattice, int axis, std::int32_t end) {
  const double q = std::clamp((value - lattice.origin[axis]) / lattice.step, 0.0, end - 1.0);
  auto below = static_cast<std::int32_t>(std::ceil(q));
  while (below > 0 && static_cast<double>(lattice.position(glm::ivec3(below))[axis]) > value) --below;
  return below;
}

/// The least of them whose position is at least `value`; end − 1 where there is none.
inline std::int32_t latticeAbove(double value, const Lattice& lattice, int axis, std::int32_t end) {
  const double q = std::clamp((value - lattice.origin[axis]) / lattice.step, 0.0, end - 1.0);
  auto above = static_cast<std::int32_t>(std::floor(q));
  while (above < end - 1 && static_cast<double>(lattice.position(glm::ivec3(above))[axis]) < value) ++above;
  return above;
}

}  // namespace lod
