#pragma once
// The points of a block, what lies near each of them, and normals by what lies near.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "lod/pmr/builder/tangent_polygon.h"
#include "lod/pmr/builder/voronoi.h"

namespace lod::pmr::builder {

/// A block of points: the first `own` are decided on, the others lie around them.
struct PointBlock {
  std::span<const glm::dvec3> places;
  std::size_t own = 0;
  /// By point: what height counts at most, and the unit of the levels' depth: heightLimits().
  std::span<const float> height_limits;
};

/// The nearest points of each point, nearest first.
class Neighbourhoods {
 public:
  explicit Neighbourhoods(std::span<const glm::dvec3> places);
  std::span<const std::uint32_t> of(std::uint32_t i) const { return std::span(found_).subspan(i * each_, each_); }

 private:
  std::size_t each_ = 0;
  std::vector<std::uint32_t> found_;
};

/// Returns what the height of each point counts at most: about eight spacings, the same for all points of a cell
/// (`cell`, by point, those of one side by side), so that levels are of equal depth in that unit, however empty the
/// cell; and no more than `most`, by point, so that polygons in wide flat parts stay within the surroundings that a
/// block knows.
std::vector<float> heightLimits(std::span<const glm::dvec3> places, const Neighbourhoods& near,
                                std::span<const std::uint32_t> cell, std::vector<float> most);

/// Gives the points at a rim the normal of the points around them. A rim's Voronoi cells are open sideways, too, so
/// that their poles tell no normal; the theory knows closed surfaces only. A point is at a rim if its tangent polygon
/// is open, or reaches four times as far as its sixth neighbour.
void mendRims(const PointBlock& block, const Neighbourhoods& near, std::span<VoronoiCell> cells);

/// Returns the unit normal of each of the first `count` points as the mean of its umbrella's triangles, weighted by
/// area as those of a mesh's vertices are; the pole's where the polygon is open. The pole tells the plane of the
/// umbrella, but wavers by some degrees, which shading shows.
std::vector<glm::dvec3> umbrellaNormals(const PointBlock& block, const Neighbourhoods& near,
                                        std::span<const VoronoiCell> cells, std::size_t count);

/// The tangent polygon of a point among `candidates`, which begins with a square of twice its height limit: where that
/// shows, the polygon is open. The nearest candidates come first, so that it is small soon.
TangentPolygon polygonOf(const PointBlock& block, std::uint32_t i, const glm::dvec3& normal,
                         std::span<const std::uint32_t> candidates);

}  // namespace lod::pmr::builder
