#pragma once
// The corners of triangles on the lattice, and the vertices that several buckets share.
#include <algorithm>
#include <cstdint>
#include <glm/glm.hpp>
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

/// Sums over a vertex' corners. They are whole numbers, so that the order in which buckets add to them does not matter.
struct VertexSums {
  glm::i64vec3 face{0};    ///< sum of latticeNormal
  glm::i64vec3 normal{0};  ///< sum of the given normals
  glm::i64vec3 color{0};
  std::int64_t colored = 0;  ///< how many corners have a colour

  /// Adds one corner; `face_normal` is its triangle's latticeNormal.
  void add(const glm::i64vec3& face_normal, const Corner& corner) {
    face += face_normal;
    if (corner.normal != 0) normal += glm::i64vec3(unpackNormal(corner.normal));
    if (corner.color >> 24 == 0) return;
    color += glm::i64vec3(corner.color & 255U, corner.color >> 8 & 255U, corner.color >> 16 & 255U);
    ++colored;
  }
  /// The mean of the given normals, or else of the triangles'; +z where neither is known.
  glm::vec3 unitNormal() const {
    for (const glm::i64vec3& sum : {normal, face}) {
      const glm::dvec3 n(sum);
      if (const double length = glm::length(n); length > 0.0) return glm::vec3(n / length);
    }
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
