#pragma once
// Cuts large triangles into small ones, so that no leaf is much larger than those around it (Rusinkiewicz and Levoy
// 2000, section 3.4).
//
// A triangle is cut at the middle of its longest edge until no edge is longer than a limit (Rivara 1984). How an edge
// is divided depends on its own length only, so that two triangles cut with the same limit share the points between
// them.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "lod/ingest/code_map.h"

namespace lod::qsplat::builder {

/// Cuts the triangles of a tile. Points are numbered, the given ones first and then the midpoints.
class Dicer {
 public:
  struct Midpoint {
    std::uint32_t a = 0, b = 0;  ///< the ends of its edge, whose numbers are below its own
    glm::dvec3 position{0.0};    ///< exact
  };
  struct SubTriangle {
    std::array<std::uint32_t, 3> corners{};
    std::uint32_t triangle = 0;
  };

  /// `points` must outlive it. Points and midpoints together must be fewer than 2^31.
  Dicer(std::span<const glm::ivec3> points, double longest_edge);
  /// Cuts a triangle that has an edge longer than the limit.
  void cut(const std::array<std::uint32_t, 3>& corners, std::uint32_t triangle);

  const std::vector<Midpoint>& midpoints() const { return midpoints_; }
  /// Wound as the triangles that they are cut from, in the order of those.
  const std::vector<SubTriangle>& subTriangles() const { return sub_triangles_; }
  glm::dvec3 position(std::uint32_t point) const {
    return point < points_.size() ? glm::dvec3(points_[point]) : midpoints_[point - points_.size()].position;
  }

 private:
  std::uint32_t midpointOf(std::uint32_t a, std::uint32_t b);

  std::span<const glm::ivec3> points_;
  double longest_squared_;
  ingest::CodeMap by_edge_{64};
  std::vector<Midpoint> midpoints_;
  std::vector<SubTriangle> sub_triangles_;
};

/// Counts the cuts of triangles, given by 3 points each. A cut makes one point, or half a point where two triangles
/// share it. Returns nothing where there are more than `max_cuts`.
std::optional<std::uint64_t> countCuts(std::span<const glm::ivec3> points, double longest_edge, std::uint64_t max_cuts);

}  // namespace lod::qsplat::builder
