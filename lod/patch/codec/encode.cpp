// Encoding of one patch: connectivity first, then what the decoder cannot predict of positions, normals and colours.
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <utility>

#include "base/check.h"
#include "base/simd.h"
#include "lod/patch/codec.h"
#include "lod/patch/codec/colors.h"
#include "lod/patch/codec/connectivity_encoder.h"
#include "lod/patch/codec/header.h"
#include "lod/patch/codec/low_bits.h"
#include "lod/patch/codec/normals.h"
#include "lod/patch/codec/residual_writer.h"
#include "lod/patch/codec/residuals.h"

namespace lod::patch {
namespace codec {
namespace {

void checkGeometry(const PatchGeometry& geometry) {
  LUMIGRID_CHECK_EQ(geometry.indices.size() % 3, 0U);
  LUMIGRID_CHECK(!geometry.indices.empty());
  LUMIGRID_CHECK_LE(geometry.indices.size() / 3, kMaxPatchTriangles);
  LUMIGRID_CHECK_LE(geometry.positions.size(), kMaxPatchVertices);
  LUMIGRID_CHECK_EQ(geometry.normals.size(), geometry.positions.size());
  if (!geometry.colors.empty()) LUMIGRID_CHECK_EQ(geometry.colors.size(), geometry.positions.size());
  std::uint16_t highest = 0;
  for (const std::uint16_t index : geometry.indices) highest = std::max(highest, index);
  LUMIGRID_CHECK_LT(std::size_t{highest}, geometry.positions.size());
  for (const glm::ivec3& q : geometry.positions)
    for (int axis = 0; axis < 3; ++axis) LUMIGRID_CHECK(q[axis] >= -kMaxLattice && q[axis] <= kMaxLattice);
}

// Positions relative to vertex 0, without their lowest `shift` bits.
void shiftedPoints(const PatchGeometry& geometry, const EncodedConnectivity& order, int shift,
                   std::vector<Float4>& points) {
  points.clear();
  const glm::ivec3 corner = geometry.positions[order.vertices[0]];
  for (const std::uint32_t old : order.vertices) {
    const glm::ivec3 q = (geometry.positions[old] - corner) >> shift;
    points.push_back(Float4{static_cast<float>(q.x), static_cast<float>(q.y), static_cast<float>(q.z), 0.0F});
  }
}

Float4 magnitude(Float4 x) {
  return x < 0.0F ? -x : x;
}

// Whether all sums of facet normals are exact in floats. The sums of magnitudes here bound them, are exact themselves
// until one is too large, and never shrink.
bool exactFacets(const std::vector<Float4>& points, const std::vector<std::uint16_t>& indices,
                 std::vector<Float4>& bounds) {
  bounds.assign(points.size(), Float4{});
  for (std::size_t t = 0; t < indices.size(); t += 3) {
    const Float4 a = magnitude(points[indices[t + 1]] - points[indices[t]]);
    const Float4 b = magnitude(points[indices[t + 2]] - points[indices[t]]);
    const Float4 bound = a * __builtin_shufflevector(b, b, 1, 2, 0, 3) + __builtin_shufflevector(a, a, 1, 2, 0, 3) * b;
    for (std::size_t k = 0; k < 3; ++k) bounds[indices[t + k]] += bound;
  }
  constexpr float kExactSum = 1 << 24;
  constexpr float kExactPoint = 1 << 23;
  Int4 beyond{};
  for (std::size_t v = 0; v < points.size(); ++v)
    beyond |= (bounds[v] >= kExactSum) | (magnitude(points[v]) >= kExactPoint);
  return (beyond[0] | beyond[1] | beyond[2]) == 0;
}

// The least shift that keeps facet normals exact, and the points that it leaves.
std::uint8_t chooseShift(const PatchGeometry& geometry, const EncodedConnectivity& order, std::vector<Float4>& points) {
  std::vector<Float4> bounds;
  points.reserve(order.vertices.size());
  for (std::uint8_t shift = 0; shift < kMaxFacetShift; ++shift) {
    shiftedPoints(geometry, order, shift, points);
    if (exactFacets(points, order.indices, bounds)) return shift;
  }
  shiftedPoints(geometry, order, kMaxFacetShift, points);
  return kMaxFacetShift;
}

// Residuals of positions, in steps of 2^low of the lattice's, against what the decoder predicts: whole parallelograms,
// or with a shift of 1 half ones.
std::vector<Uint4> positionResiduals(const std::vector<Uint4>& at, const EncodedConnectivity& order, int shift,
                                     int low) {
  const std::uint32_t half = (1U << low) >> 1;
  std::vector<Uint4> numbers(groupsOf(at.size()) * kGroup, Uint4{});
  for (std::size_t v = 1; v < at.size(); ++v) {
    const FrontEdge& e = order.gates[v];
    const Int4 across = reinterpret_cast<Int4>(at[e.b] - at[e.opposite]) >> shift;
    const Uint4 predicted = at[e.a] + reinterpret_cast<Uint4>(across) + half;
    numbers[v] = zigzag(
        reinterpret_cast<Uint4>((reinterpret_cast<Int4>(at[v]) >> low) - (reinterpret_cast<Int4>(predicted) >> low)));
  }
  return numbers;
}

// About how many bits residuals take.
std::uint64_t bitsOf(const std::vector<Uint4>& numbers) {
  std::uint64_t bits = 0;
  for (std::size_t v = 0; v < numbers.size(); v += kGroup) {
    std::array<std::uint64_t, 3> sums{};
    for (std::size_t i = v; i < v + kGroup; ++i)
      for (std::size_t k = 0; k < 3; ++k) sums[k] += numbers[i][k];
    for (const std::uint64_t sum : sums) bits += static_cast<std::uint64_t>(std::bit_width(sum));
  }
  return bits;
}

// Residuals of the patch's positions. The header's flags say what took the least room: which of the two predictions,
// and how many low bits are stored apart.
std::vector<Uint4> choosePositionResiduals(const std::vector<Uint4>& at, const EncodedConnectivity& order,
                                           PatchHeader& header) {
  std::vector<Uint4> best;
  std::uint64_t least = std::numeric_limits<std::uint64_t>::max();
  for (int low = 0; low <= kMostLowBits; ++low) {
    const std::size_t apart = low > 0 ? countLowBits(at, low) : 0;
    if (2 * apart > at.size()) break;
    const std::uint64_t more = low > 0 ? at.size() + 3 * static_cast<std::uint64_t>(low) * apart : 0;
    for (int shift = 0; shift <= 1; ++shift) {
      std::vector<Uint4> residuals = positionResiduals(at, order, shift, low);
      const std::uint64_t bits = kGroup * bitsOf(residuals) + more;
      if (bits >= least) continue;
      least = bits;
      best = std::move(residuals);
      header.flags = static_cast<std::uint8_t>((header.flags & ~(kIsRough | kMostLowBits << kLowBitsShift)) |
                                               shift * kIsRough | low << kLowBitsShift);
    }
  }
  return best;
}

// Three planes of residuals that are given vertex by vertex, in whole groups.
void writeThreePlanes(base::ByteWriter& out, const std::vector<Uint4>& numbers, ResidualWriter& writer) {
  std::array<std::vector<std::uint32_t>, 3> planes;
  for (auto& plane : planes) plane.resize(numbers.size());
  for (std::size_t v = 0; v < numbers.size(); v += 4) {
    const auto turned = base::transposed(&numbers[v]);
    for (std::size_t k = 0; k < 3; ++k) std::memcpy(&planes[k][v], &turned[k], sizeof(Uint4));
  }
  for (const auto& plane : planes) writer.write(out, plane);
}

// Residuals of the normals' codes against those that the decoder predicts from positions and triangles.
void writeNormals(base::ByteWriter& out, const PatchGeometry& geometry, const EncodedConnectivity& order,
                  const std::vector<Float4>& points, ResidualWriter& writer) {
  const std::size_t vertices = order.vertices.size();
  std::vector<FacetSum> sums(vertices);
  for (std::size_t v = 0; v < vertices; ++v) sums[v].point = points[v];
  sumFacets(order.indices.data(), order.triangles.size(), sums.data());

  std::array<std::vector<std::uint32_t>, 2> planes;
  for (auto& plane : planes) plane.resize(groupsOf(vertices) * kGroup, 0);
  NormalBlock sum{}, given{};
  std::array<std::int32_t, kNormalBlock> predicted_u, predicted_v, u, v;
  for (std::size_t first = 0; first < vertices; first += kNormalBlock) {
    const std::size_t count = std::min(kNormalBlock, vertices - first);
    for (std::size_t i = 0; i < count; ++i) {
      const Float4& s = sums[first + i].sum;
      sum.z[i] = s[0], sum.x[i] = s[1], sum.y[i] = s[2];
      const glm::vec3& n = geometry.normals[order.vertices[first + i]];
      given.x[i] = n.x, given.y[i] = n.y, given.z[i] = n.z;
    }
    predictNormals(sum, count, predicted_u.data(), predicted_v.data());
    encodeNormals(given, count, u.data(), v.data());
    // Codes are bytes, so differences count modulo 256.
    const auto difference = [](std::int32_t a, std::int32_t b) {
      return zigzag(static_cast<std::int32_t>(static_cast<std::uint32_t>(a - b) << 24) >> 24);
    };
    for (std::size_t i = 0; i < count; ++i) {
      planes[0][first + i] = difference(u[i], predicted_u[i]);
      planes[1][first + i] = difference(v[i], predicted_v[i]);
    }
  }
  for (const auto& plane : planes) writer.write(out, plane);
}

// A colour is predicted as the mean of the ends of the gate where its vertex was new, rounded up.
void writeColors(base::ByteWriter& out, const PatchGeometry& geometry, const EncodedConnectivity& order,
                 ResidualWriter& writer) {
  std::vector<Int4> codes;
  codes.reserve(order.vertices.size());
  for (const std::uint32_t old : order.vertices) codes.push_back(codeOfColor(geometry.colors[old]));
  std::vector<Uint4> numbers(groupsOf(codes.size()) * kGroup, Uint4{});
  numbers[0] = zigzag(reinterpret_cast<Uint4>(codes[0]));
  for (std::size_t v = 1; v < codes.size(); ++v) {
    const Int4 predicted = (codes[order.gates[v].a] + codes[order.gates[v].b] + 1) >> 1;
    numbers[v] = zigzag(reinterpret_cast<Uint4>(codes[v] - predicted));
  }
  writeThreePlanes(out, numbers, writer);
}

void writeAlphas(base::ByteWriter& out, const PatchGeometry& geometry, const EncodedConnectivity& order,
                 ResidualWriter& writer) {
  std::vector<std::uint32_t> plane(groupsOf(order.vertices.size()) * kGroup, 0);
  for (std::size_t v = 0; v < order.vertices.size(); ++v) plane[v] = zigzag(geometry.colors[order.vertices[v]].a - 255);
  writer.write(out, plane);
}

PatchHeader headerOf(const PatchGeometry& geometry, const EncodedConnectivity& order) {
  PatchHeader header;
  header.vertices = static_cast<std::uint32_t>(order.vertices.size());
  header.triangles = static_cast<std::uint32_t>(order.triangles.size());
  header.front_bits = order.front_bits;
  header.first_position = geometry.positions[order.vertices[0]];
  header.steps = order.steps;
  header.escape_bytes = static_cast<std::uint32_t>(order.escapes.size());
  const auto isOpaque = [&](std::uint32_t old) { return geometry.colors[old].a == 255; };
  if (!geometry.colors.empty()) {
    header.flags |= kHasColors;
    if (!std::all_of(order.vertices.begin(), order.vertices.end(), isOpaque)) header.flags |= kHasAlpha;
  }
  return header;
}

}  // namespace
}  // namespace codec

base::Bytes encodePatch(const PatchGeometry& geometry, std::vector<std::uint32_t>* triangle_order,
                        StoredNormals normals) {
  using namespace codec;
  checkGeometry(geometry);
  const EncodedConnectivity order = encodeConnectivity(geometry);
  PatchHeader header = headerOf(geometry, order);
  if (normals == StoredNormals::kOfFacets) header.flags |= kNormalsOfFacets;
  std::vector<base::Float4> points;
  header.facet_shift = chooseShift(geometry, order, points);
  std::vector<base::Uint4> positions;
  positions.reserve(order.vertices.size());
  for (const std::uint32_t old : order.vertices) {
    const glm::uvec3 q(geometry.positions[old]);
    positions.push_back(base::Uint4{q.x, q.y, q.z, 0U});
  }
  const std::vector<base::Uint4> residuals = choosePositionResiduals(positions, order, header);

  base::ByteWriter out;
  writeHeader(out, header);
  out.bytes(order.step_bytes);
  out.bytes(order.escapes);
  ResidualWriter writer(groupsOf(order.vertices.size()) * kGroup);
  writeThreePlanes(out, residuals, writer);
  if (header.lowBits() > 0) writeLowBits(out, positions, header.lowBits());
  if (header.hasNormals()) writeNormals(out, geometry, order, points, writer);
  if (header.hasColors()) writeColors(out, geometry, order, writer);
  if (header.hasAlpha()) writeAlphas(out, geometry, order, writer);
  out.patch(kCrcOffset, checksum(out.view()));
  if (triangle_order != nullptr) *triangle_order = order.triangles;
  return out.takeBytes();
}

}  // namespace lod::patch
