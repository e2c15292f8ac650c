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

/// A part of a surface: what is within `reach` of a triangle, or of a point that is all three corners.
struct SurfacePart {
  std::array<glm::vec3, 3> corners{};
  float reach = 0.0F;
  float area = 0.0F;  ///< in squared units of the corners; 0 or more
};
/// A triangle, of which the surface may lie off by `reach`.
SurfacePart trianglePart(const std::array<glm::vec3, 3>& corners, float reach = 0.0F);
/// A ball that holds a piece of the surface as large as its section.
SurfacePart ballPart(const glm::vec3& center, float radius);

/// Points whose convex hull holds all parts but strays, within 1 % as far as 218 directions tell: the outermost places,
/// moved away from the middle where so few of them would cut off what is round. Strays are parts behind a gap of a
/// quarter of the surface's size, where they have at most 0.2 % of all area. At most kMaxHullPoints, and not empty
/// unless there are no parts.
std::vector<glm::vec3> findHull(std::span<const SurfacePart> parts);

}  // namespace lod::patch
