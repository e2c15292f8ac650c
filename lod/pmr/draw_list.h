#pragma once
// Lists of the points and triangles of a leaf at a level, in an order in which those to draw, for any size of a pixel,
// are a part of each list without gaps (Dey and Hudson 2002, section 3, "Point vs. umbrella").
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace lod::pmr {

/// The part of a list that is drawn, [first, end).
struct DrawnPart {
  std::uint32_t first = 0, end = 0;
  std::uint32_t count() const { return end - first; }
};

struct DrawList {
  std::vector<std::uint16_t> points;   ///< own points, by falling umbrella radius
  std::vector<float> point_radii;      ///< of each: the longest edge of its triangles, scene units; 0 without triangle
  std::vector<std::uint16_t> corners;  ///< three for each triangle, by falling reach
  std::vector<float> reaches;          ///< of each triangle: the largest umbrella radius of its own points

  /// Points whose umbrella would lie within the pixel: twice the radius is below the pixel's size (scene units), so
  /// they are drawn as points.
  DrawnPart pointsAt(float pixel) const;
  /// Triangles in the umbrella of any point that is not.
  DrawnPart trianglesAt(float pixel) const;
};

/// The mean radius of the umbrellas that have triangles; 0 without any.
float meanRadius(const DrawList& list);

/// `is_own`: for each of the leaf's vertices at the level whether it is its own point.
DrawList makeDrawList(std::span<const glm::vec3> positions, const std::vector<bool>& is_own,
                      std::span<const std::uint16_t> corners);

}  // namespace lod::pmr
