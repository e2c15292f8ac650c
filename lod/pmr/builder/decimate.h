#pragma once
// Decimation by the ratio of radius and height of Voronoi cells (Dey and Hudson 2002, section 2, "Point hierarchy").
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "lod/pmr/builder/voronoi.h"

namespace lod::pmr::builder {

/// A block of points: the first `own` are decided on, the others lie around them.
struct PointBlock {
  std::span<const glm::dvec3> places;
  std::size_t own = 0;
  /// By point: what height counts at most, so that the polygons of points in wide flat parts stay within the
  /// surroundings that a block knows.
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

/// Gives the points at a rim the normal of the points around them. A rim's Voronoi cells are open sideways, too, so
/// that their poles tell no normal; the theory knows closed surfaces only. A point is at a rim if its tangent polygon
/// is open, or reaches four times as far as its sixth neighbour.
void mendRims(const PointBlock& block, const Neighbourhoods& near, std::span<VoronoiCell> cells);

/// Returns the class of each own point: the coarsest level that it is part of. For each level in turn the point of the
/// least ratio is deleted until none is below the level's threshold; the polygons of its neighbours grow at once. The
/// height stays that of all points: it measures the shape, and the denser the points, the better. Points at a rim stay.
///
/// The others are treated alike, as far as the block knows, and so, nearly always, as their own block treats them.
std::vector<std::uint8_t> decimate(const PointBlock& block, const Neighbourhoods& near,
                                   std::span<const VoronoiCell> cells);

}  // namespace lod::pmr::builder
