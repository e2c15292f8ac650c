#pragma once
// The corners of triangles on the lattice, and the vertices that several buckets share.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <numbers>
#include <vector>

#include "lod/ingest/source_spool.h"

namespace lod::ingest {

/// A vertex is known by its lattice point alone: corners at one point are one vertex, in whatever bucket, file or
/// level.
struct Corner {
  std::uint64_t code = 0;    ///< Morton code of the lattice point
  std::uint32_t color = 0;   ///< R G B A from the lowest byte; A = 0 where unknown
  std::uint32_t normal = 0;  ///< packNormal; 0 where unknown
};

/// Twice the triangle's area times its normal, exact in lattice steps.
inline glm::i64vec3 latticeNormal(const glm::ivec3& a, const glm::ivec3& b, const glm::ivec3& c) {
  const glm::i64vec3 u(b - a);
  const glm::i64vec3 v(c - a);
  return {u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
}

/// The angle in radians, 0 to pi, whose sine and cosine stand to each other as these do, to 1e-5; `sine` >= 0
/// (Abramowitz and Stegun 1964, 4.4.49).
inline double angleOf(double sine, double cosine) {
  const double of_cosine = std::abs(cosine);
  const double ratio = std::min(sine, of_cosine) / std::max(sine, of_cosine), r = ratio * ratio;
  const double below = ratio * (0.9998660 + r * (-0.3302995 + r * (0.1801410 + r * (-0.0851330 + r * 0.0208351))));
  const double angle = sine < of_cosine ? below : 0.5 * std::numbers::pi - below;
  return cosine < 0.0 ? std::numbers::pi - angle : angle;
}

/// The directions of the triangles around a vertex, in sums of whole numbers, so that their order does not matter.
struct FacetSums {
  glm::i64vec3 by_area{0};   ///< sum of latticeNormal
  glm::i64vec3 by_angle{0};  ///< sum of unit normals times the angle at the vertex, in steps of 2^-20
  std::int64_t angle = 0;    ///< sum of these angles, in the same steps

  FacetSums& operator+=(const FacetSums& other) {
    by_area += other.by_area, by_angle += other.by_angle, angle += other.angle;
    return *this;
  }
  /// The mean direction by area, as the codec of patches expects it; where the triangles lie round a hard edge, that by
  /// angle (Thürmer and Wüthrich 1998): it leans from a large side and a small one alike, by which a viewer knows
  /// the edge from a curve (docs/decisions/normals-of-facets.md). Zero where there is none.
  glm::dvec3 mean() const { return isHard() ? glm::dvec3(by_angle) : glm::dvec3(by_area); }
  /// Whether sides meet here at about 52 degrees or more, unless they cancel each other.
  bool isHard() const {
    constexpr double kHard = 0.9;  // mean cosine
    const double along = glm::length(glm::dvec3(by_angle));
    return along > 0.0 && along < kHard * static_cast<double>(angle);
  }
};

/// Returns what a triangle adds to its corners; nothing where it has no area. `normal`: its latticeNormal.
inline std::array<FacetSums, 3> facetAtCorners(const glm::i64vec3& normal, const glm::ivec3& a, const glm::ivec3& b,
                                               const glm::ivec3& c) {
  constexpr double kSteps = 1 << 20;
  std::array<FacetSums, 3> corners;
  const glm::dvec3 n(normal), u(b - a), v(c - a);
  const double length = glm::length(n);
  if (!(length > 0.0)) return corners;
  const double along = glm::dot(u, v);
  const double at_a = angleOf(length, along), at_b = angleOf(length, glm::dot(u, u) - along);
  const std::array<double, 3> angles{at_a, at_b, std::max(0.0, std::numbers::pi - at_a - at_b)};
  for (std::size_t k = 0; k < 3; ++k)
    corners[k] = {normal, glm::i64vec3(n * (kSteps / length * angles[k])),
                  static_cast<std::int64_t>(kSteps * angles[k])};
  return corners;
}
inline std::array<FacetSums, 3> facetAtCorners(const glm::ivec3& a, const glm::ivec3& b, const glm::ivec3& c) {
  return facetAtCorners(latticeNormal(a, b, c), a, b, c);
}

/// Sums over a vertex' corners. They are whole numbers, so that the order in which buckets add to them does not matter.
struct VertexSums {
  FacetSums facets;
  glm::i64vec3 normal{0};  ///< sum of the given normals
  glm::i64vec3 color{0};
  std::int64_t colored = 0;  ///< how many corners have a colour

  /// Adds one corner; `facet` is its triangle's, of facetAtCorners.
  void add(const FacetSums& facet, const Corner& corner) {
    facets += facet;
    if (corner.normal != 0) normal += glm::i64vec3(unpackNormal(corner.normal));
    if (corner.color >> 24 == 0) return;
    color += glm::i64vec3(corner.color & 255U, corner.color >> 8 & 255U, corner.color >> 16 & 255U);
    ++colored;
  }
  /// The mean of the given normals, or else of the triangles'; +z where neither is known. `is_lit`: light may show
  /// them; else that of the triangles is by area alone.
  glm::vec3 unitNormal(bool is_lit = true) const {
    for (const glm::dvec3& n : {glm::dvec3(normal), is_lit ? facets.mean() : glm::dvec3(facets.by_area)})
      if (const double length = glm::length(n); length > 0.0) return glm::vec3(n / length);
    return {0.0F, 0.0F, 1.0F};
  }

  /// White where no colour is known.
  glm::u8vec4 meanColor() const {
    if (colored == 0) return glm::u8vec4(255);
    auto mean = [this](int k) { return static_cast<std::uint8_t>((color[k] + colored / 2) / colored); };
    return {mean(0), mean(1), mean(2), 255};
  }
};

/// Vertices that several buckets use, by Morton code, ascending.
struct BorderVertices {
  std::vector<std::uint64_t> codes;
  std::vector<VertexSums> sums;  ///< as many as codes

  /// Fills the filter, which find() needs.
  void makeFilter() {
    if (codes.empty()) return;
    filter_.assign(std::size_t{1} << kFilterBits, false);
    for (const std::uint64_t code : codes) filter_[filterSlot(code)] = true;
  }
  /// The place of a code among `codes`, or -1.
  std::int64_t find(std::uint64_t code) const {
    if (codes.empty() || !filter_[filterSlot(code)]) return -1;
    const auto at = std::lower_bound(codes.begin(), codes.end(), code);
    return at != codes.end() && *at == code ? at - codes.begin() : -1;
  }

 private:
  static constexpr std::uint32_t kFilterBits = 22;  // half a megabyte, which stays in a core's cache
  static std::size_t filterSlot(std::uint64_t code) {
    return static_cast<std::size_t>((code * 0x9E3779B97F4A7C15ULL) >> (64 - kFilterBits));
  }
  // A bit per hash of a code: most vertices are not on the border, and one look here tells.
  std::vector<bool> filter_;
};

/// The place of a vertex that is not on the border, in place of one among BorderVertices.
inline constexpr std::uint32_t kNotOnBorder = 0xFFFFFFFFU;

/// A triangle with a corner on the border.
struct BorderTriangle {
  std::uint32_t triangle = 0;                                           ///< its place in the bucket
  std::uint32_t place[3] = {kNotOnBorder, kNotOnBorder, kNotOnBorder};  ///< numbers of its corners among BorderVertices
  Corner corner[3];
};

}  // namespace lod::ingest
