#pragma once
// The umbrellas of points: the Delaunay triangles dual to the Voronoi edges that the tangent polygon crosses (Dey and
// Hudson 2002, section 2, "Triangle hierarchy").
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "lod/ingest/nearest_points.h"

namespace lod::pmr::builder {

/// Three points, by rising number.
using Triangle = std::array<std::uint32_t, 3>;

/// Finds umbrellas among the points of a level, each by itself: the points and the normal of its centre decide it, so
/// that whoever finds it finds the same.
class Umbrellas {
 public:
  /// `numbers`: what the triangles call the points. All must outlive it.
  Umbrellas(std::span<const glm::dvec3> places, std::span<const std::uint32_t> numbers);

  /// Appends the triangles around the point at index i of the constructor's lists. Corners of the tangent polygon lie
  /// within a square of half the edge of twice the distance of the 16th nearest point, four to five spacings: what
  /// would be farther away is no surface but a gap or a rim.
  void find(std::uint32_t i, const glm::vec3& unit_normal, std::vector<Triangle>& out);

 private:
  std::span<const glm::dvec3> places_;
  std::span<const std::uint32_t> numbers_;
  std::vector<glm::vec3> floats_;
  std::optional<ingest::NearestPoints> near_;
  std::vector<ingest::NearestPoints::Neighbour> found_;
};

}  // namespace lod::pmr::builder
