#pragma once
// Lists of the points and triangles of a leaf at a level, in orders in which those to draw, for any size of a pixel,
// are a part of each list without gaps (Dey and Hudson 2002, section 3, "Point vs. umbrella").
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
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
  std::vector<std::uint16_t> corners;  ///< three for each triangle, in the order in which they were given
  /// The least reach of all triangles. A triangle's reach is the largest umbrella radius of its own points.
  float least_reach = std::numeric_limits<float>::infinity();

  /// Points whose umbrella would lie within the pixel: twice the radius is below the pixel's size (scene units), so
  /// they are drawn as points.
  DrawnPart pointsAt(float pixel) const;
  /// Whether all triangles lie in the umbrella of any point that is not.
  bool drawsAllTriangles(float pixel) const { return !(2.0F * least_reach < pixel); }
};

/// The triangles of a list in an order for pixels at which only a part of them is drawn. The order in which they are
/// coded is better where all are: neighbours follow each other, so that a GPU shades their common vertices once.
struct SortedTriangles {
  std::vector<std::uint16_t> corners;
  std::vector<float> reaches;  ///< of each triangle, falling
};
/// `vertices`: how many the leaf has at the level.
SortedTriangles sortedTriangles(const DrawList& list, std::size_t vertices);

/// How many of falling radii or reaches are not within the pixel. Triangles so far are drawn: they lie in the umbrella
/// of a point that is not drawn as a point.
std::uint32_t countUmbrellas(std::span<const float> falling, float pixel);

/// The mean radius of the umbrellas that have triangles; 0 without any.
float meanRadius(const DrawList& list);

/// `is_own`: for each of the leaf's vertices at the level whether it is its own point.
DrawList makeDrawList(std::span<const glm::vec3> positions, const std::vector<bool>& is_own,
                      std::vector<std::uint16_t> corners);

}  // namespace lod::pmr
