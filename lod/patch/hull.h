#pragma once
// A few points around a surface: a view that shows them shows the surface. A box around a scan that lies at a slant in
// it is mostly empty.
#include <array>
#include <cstddef>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace lod::patch {

inline constexpr std::size_t kMaxHullPoints = 32;

/// Points whose convex hull holds the corners of all triangles but strays, within 1 % as far as 218 directions tell:
/// the outermost corners, moved away from the middle where so few of them would cut off what is round. Strays are
/// triangles behind a gap of a quarter of the surface's size, where they have at most 0.2 % of all area. At most
/// kMaxHullPoints, and not empty unless there are no triangles.
std::vector<glm::vec3> findHull(std::span<const std::array<glm::vec3, 3>> triangles);

}  // namespace lod::patch
