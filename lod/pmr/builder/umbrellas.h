#pragma once
// The umbrellas of points: the Delaunay triangles dual to the Voronoi edges that the tangent polygon crosses (Dey and
// Hudson 2002, section 2, "Triangle hierarchy").
#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "lod/ingest/nearest_points.h"
#include "lod/pmr/builder/tangent_polygon.h"

namespace lod::pmr::builder {

/// Three points, by rising number, as one number that sorts fast. Numbers are below 2^21.
class Triangle {
 public:
  static constexpr std::uint32_t kMaxPoints = std::uint32_t{1} << 21;
  Triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (a > b) std::swap(a, b);
    if (b > c) std::swap(b, c);
    if (a > b) std::swap(a, b);
    key_ = std::uint64_t{a} << 42 | std::uint64_t{b} << 21 | c;
  }
  std::array<std::uint32_t, 3> corners() const {
    const auto part = [this](int bits) { return static_cast<std::uint32_t>(key_ >> bits & (kMaxPoints - 1)); };
    return {part(42), part(21), part(0)};
  }
  friend auto operator<=>(const Triangle&, const Triangle&) = default;

 private:
  std::uint64_t key_ = 0;
};

/// The numbers of the points around an umbrella's centre, in order; kNone where it is open. Each two that follow each
/// other, the last and the first too, make a triangle with the centre.
struct Umbrella {
  static constexpr std::uint32_t kNone = TangentPolygon::kNone;
  std::uint32_t count = 0;
  std::array<std::uint32_t, TangentPolygon::kMaxCorners> around;

  /// A closed umbrella stays the same as long as all its points do: others that are deleted do not change its polygon.
  bool isClosed() const { return std::find(around.begin(), around.begin() + count, kNone) == around.begin() + count; }
  void appendTriangles(std::uint32_t center, std::vector<Triangle>& out) const;
};

/// Finds umbrellas among the points of a level, each by itself: the points and the normal of its centre decide it, so
/// that whoever finds it finds the same.
class Umbrellas {
 public:
  /// `numbers`: what the triangles call the points. All must outlive it.
  Umbrellas(std::span<const glm::dvec3> places, std::span<const std::uint32_t> numbers);

  /// Finds the umbrella of the point at index i of the constructor's lists. `out` is replaced. Corners of the tangent
  /// polygon lie within a square of half the edge `reach`, but at least twice the distance of the 16th nearest point,
  /// four to five spacings: with 0 what would be farther away is no surface but a gap or a rim. At level 0 that tells
  /// who is at a rim; the umbrellas of all others are closed, and stay so at all levels, however far their points are
  /// apart.
  void find(std::uint32_t i, const glm::vec3& unit_normal, double reach, Umbrella& out);

 private:
  std::span<const glm::dvec3> places_;
  std::span<const std::uint32_t> numbers_;
  std::vector<glm::vec3> floats_;
  std::optional<ingest::NearestPoints> near_;
  std::vector<ingest::NearestPoints::Neighbour> found_;
};

}  // namespace lod::pmr::builder
