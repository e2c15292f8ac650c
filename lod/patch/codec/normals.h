#pragma once
// Normals of a patch: octahedral codes (Cigolle et al. 2014, "A Survey of Efficient Representations for Independent
// Unit Vectors", section 3.3) of 8 + 8 bits, and their prediction from the facets around a vertex.
//
// Blocks lie coordinate by coordinate, so that the compiler vectorises the loops over them; everything here becomes
// part of its caller and is compiled for the caller's processor.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "base/simd.h"

namespace lod::patch::codec {

/// Normals that are coded at once. Blocks of 64 stay in the nearest cache.
inline constexpr std::size_t kNormalBlock = 64;

struct NormalBlock {
  std::array<float, kNormalBlock> x, y, z;
};

/// x in [−1, 1] as −127 … 127, halves rounded away from zero.
LUMIGRID_ALWAYS_INLINE std::int32_t toSnorm8(float x) {
  const float scaled = std::min(std::max(x, -1.0F), 1.0F) * 127.0F;
  const auto whole = static_cast<std::int32_t>(scaled);
  const auto to = static_cast<float>(whole);
  return whole + (scaled >= to + 0.5F ? 1 : 0) - (scaled <= to - 0.5F ? 1 : 0);
}

/// Codes of the first `count` normals of any length. Zero, infinite and NaN ones get the code of +z.
LUMIGRID_ALWAYS_INLINE void encodeNormals(const NormalBlock& in, std::size_t count, std::int32_t* codes_u,
                                          std::int32_t* codes_v) {
  for (std::size_t i = 0; i < count; ++i) {
    // Project onto the octahedron |x| + |y| + |z| = 1; a NaN anywhere makes the sum fail the test.
    const float sum = std::abs(in.x[i]) + std::abs(in.y[i]) + std::abs(in.z[i]);
    const bool good = sum > 0.0F && sum <= std::numeric_limits<float>::max();
    const float x = good ? in.x[i] / sum : 0.0F;
    const float y = good ? in.y[i] / sum : 0.0F;
    const float z = good ? in.z[i] : 0.0F;

    // Fold the lower half outwards.
    const float rest_x = 1.0F - std::abs(y);
    const float rest_y = 1.0F - std::abs(x);
    const float folded_x = x >= 0.0F ? rest_x : -rest_x;
    const float folded_y = y >= 0.0F ? rest_y : -rest_y;
    codes_u[i] = toSnorm8(z >= 0.0F ? x : folded_x);
    codes_v[i] = toSnorm8(z >= 0.0F ? y : folded_y);
  }
}

/// Unit normals of codes −128 … 127; −128 means −127.
LUMIGRID_ALWAYS_INLINE void decodeNormals(const std::int32_t* codes_u, const std::int32_t* codes_v, std::size_t count,
                                          NormalBlock& out) {
  for (std::size_t i = 0; i < count; ++i) {
    // Integers until the fold is done, so that directions with two codes come out bit-equal.
    const std::int32_t u = std::max(codes_u[i], -127);
    const std::int32_t v = std::max(codes_v[i], -127);
    const std::int32_t z = 127 - std::abs(u) - std::abs(v);
    const std::int32_t folded_x = u >= 0 ? 127 - std::abs(v) : std::abs(v) - 127;
    const std::int32_t folded_y = v >= 0 ? 127 - std::abs(u) : std::abs(u) - 127;
    const auto x = static_cast<float>(z < 0 ? folded_x : u);
    const auto y = static_cast<float>(z < 0 ? folded_y : v);
    const auto w = static_cast<float>(z);
    // The sum is at most 3 · 127², so it is exact however the compiler fuses it.
    const float inverse = 1.0F / std::sqrt(x * x + y * y + w * w);
    out.x[i] = x * inverse;
    out.y[i] = y * inverse;
    out.z[i] = w * inverse;
  }
}

/// The codes of sums of facet normals. No multiplication feeds an addition, so every machine gets the same codes.
LUMIGRID_ALWAYS_INLINE void predictNormals(const NormalBlock& sums, std::size_t count, std::int32_t* u,
                                           std::int32_t* v) {
  for (std::size_t i = 0; i < count; ++i) {
    const float ax = std::abs(sums.x[i]);
    const float ay = std::abs(sums.y[i]);
    const float az = std::abs(sums.z[i]);
    const float sum_x = ax + az;
    const float sum_y = ay + az;
    const float total = sum_x + ay;
    const float total_y = sum_y + ax;
    const float along_x = sums.z[i] < 0.0F ? sum_x : ax;
    const float along_y = sums.z[i] < 0.0F ? sum_y : ay;
    const float a = 127.0F * along_x / (total > 0.0F ? total : 1.0F);
    const float b = 127.0F * along_y / (total_y > 0.0F ? total_y : 1.0F);
    const auto p = static_cast<std::int32_t>(a + 0.5F);
    const auto q = static_cast<std::int32_t>(b + 0.5F);
    u[i] = sums.x[i] < 0.0F ? -p : p;
    v[i] = sums.y[i] < 0.0F ? -q : q;
  }
}

/// A vertex while facet normals are summed. Lanes: z, x, y of the sum; x, y, z of the point.
struct alignas(32) FacetSum {
  base::Float4 point{};
  base::Float4 sum{};
};

/// Adds each facet's normal, twice its area long, to the sums of its corners. With the encoder's facet shift every sum
/// is exact, so the order does not matter. Eight runs of triangles take turns, since neighbours within one run share
/// corners and wait for each other.
LUMIGRID_ALWAYS_INLINE void sumFacets(const std::uint16_t* indices, std::size_t triangles, FacetSum* vertices) {
  using base::Float4;
  const auto add = [&](std::size_t t) __attribute__((always_inline)) {
    FacetSum& p = vertices[indices[3 * t]];
    FacetSum& q = vertices[indices[3 * t + 1]];
    FacetSum& r = vertices[indices[3 * t + 2]];
    // Both edges are reversed, which leaves their product as it is.
    const Float4 a = p.point - q.point;
    const Float4 b = p.point - r.point;
    const Float4 normal = a * __builtin_shufflevector(b, b, 1, 2, 0, 3) - __builtin_shufflevector(a, a, 1, 2, 0, 3) * b;
    p.sum += normal;
    q.sum += normal;
    r.sum += normal;
  };
  constexpr std::size_t kRuns = 8;
  const std::size_t run = triangles / kRuns;
  for (std::size_t t = 0; t < run; ++t)
    for (std::size_t r = 0; r < kRuns; ++r) add(r * run + t);
  for (std::size_t t = kRuns * run; t < triangles; ++t) add(t);
}

}  // namespace lod::patch::codec
