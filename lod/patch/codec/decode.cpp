// Decoding of one patch. decodeParts() is compiled once for each kind of processor.
#include <algorithm>
#include <array>
#include <cstring>
#include <span>

#include "base/simd.h"
#include "lod/patch/codec.h"
#include "lod/patch/codec/colors.h"
#include "lod/patch/codec/connectivity_decoder.h"
#include "lod/patch/codec/header.h"
#include "lod/patch/codec/low_bits.h"
#include "lod/patch/codec/normals.h"
#include "lod/patch/codec/processors.h"
#include "lod/patch/codec/residual_reader.h"
#include "lod/patch/codec/residuals.h"

namespace lod::patch {
namespace codec {
namespace {

// The memory that decoding needs beyond its result. Each thread keeps its own, as patches come by the thousand.
struct Scratch {
  base::Bytes bytes;
  std::vector<std::uint8_t> widths;
  std::vector<std::uint8_t> places;
  std::vector<std::uint64_t> front;
  std::vector<std::uint64_t> gates;  // packEdge() by vertex
  std::vector<Uint4> positions;
  std::vector<Uint4> low_bits;
  std::vector<Uint4> colors;
  std::array<std::vector<std::uint32_t>, 3> planes;
  std::vector<std::uint32_t> normal_u;
  std::vector<std::uint32_t> normal_v;
  std::vector<std::uint32_t> alphas;
  std::vector<FacetSum> facet_sums;
  // The result, with room for whole vectors behind it. Copying it in the end takes less time than clearing a result
  // vector in the beginning.
  std::vector<std::uint16_t> indices;
  std::vector<glm::ivec3> lattice;
  std::vector<glm::vec3> normals;
  std::vector<glm::u8vec4> rgba;

  template <class T>
  static T* room(std::vector<T>& v, std::size_t count) {
    if (v.size() < count) v.resize(count);
    return v.data();
  }
  ResidualRoom residualRoom(std::size_t groups) {
    return {room(widths, groups / 2 + 16), room(places, groups * kGroup + 80)};
  }
};

// A page has one loop for patches with low bits and without, which takes less room; elsewhere each has its own, which
// takes less time.
#if defined(__EMSCRIPTEN__)
constexpr bool kOneLoop = true;
#else
constexpr bool kOneLoop = false;
#endif

// Adds predictions to the residuals in scratch.positions and scratch.colors. That makes lattice points, points relative
// to vertex 0 for the facet normals, and colour codes. One pass does all of it, since each vertex waits for the one
// before. False when a point lies outside the lattice.
template <bool kColors, bool kLowBits>
LUMIGRID_ALWAYS_INLINE bool addPredictions(const PatchHeader& header, const std::uint64_t* gates, Scratch& scratch,
                                           glm::ivec3* out) {
  Uint4* at = scratch.positions.data();
  Uint4* color = scratch.colors.data();
  FacetSum* facet_sums = Scratch::room(scratch.facet_sums, groupsOf(header.vertices) * kGroup);
  const Uint4 first{static_cast<std::uint32_t>(header.first_position.x),
                    static_cast<std::uint32_t>(header.first_position.y),
                    static_cast<std::uint32_t>(header.first_position.z), 0U};
  const Int4 facet_shift = Int4{} + static_cast<std::int32_t>(header.facet_shift);
  const Int4 parallelogram_shift = Int4{} + header.parallelogramShift();
  const Int4 low_shift = Int4{} + header.lowBits();
  const Uint4 half = Uint4{} + ((1U << header.lowBits()) >> 1);
  const Uint4* low = scratch.low_bits.data();
  at[0] += first;
  const Uint4 origin = at[0];
  Int4 lowest = reinterpret_cast<Int4>(origin);
  Int4 highest = lowest;
  const auto finish = [&](std::size_t v, Uint4 q) __attribute__((always_inline)) {
    const auto lattice = reinterpret_cast<Int4>(q);
    lowest = lattice < lowest ? lattice : lowest;
    highest = lattice > highest ? lattice : highest;
    facet_sums[v] = {__builtin_convertvector(reinterpret_cast<Int4>(q - origin) >> facet_shift, Float4), Float4{}};
    // The fourth lane is written over by the next point.
    std::memcpy(reinterpret_cast<std::uint8_t*>(out + v), &q, sizeof(q));
  };
  finish(0, origin);
  const std::size_t vertices = header.vertices;
  for (std::size_t v = 1; v < vertices; ++v) {
    const std::uint64_t e = gates[v];
    const std::size_t a = e & 0xFFFF;
    const std::size_t b = e >> 16 & 0xFFFF;
    const std::size_t opposite = e >> 32 & 0xFFFF;
    // Vertex a is most often the one before; it is added last, so that little waits for it.
    const Uint4 across = reinterpret_cast<Uint4>(reinterpret_cast<Int4>(at[b] - at[opposite]) >> parallelogram_shift);
    Uint4 q;
    if constexpr (kLowBits) {
      const Int4 predicted = reinterpret_cast<Int4>(across + half + at[a]) >> low_shift;
      q = ((reinterpret_cast<Uint4>(predicted) + at[v]) << reinterpret_cast<Uint4>(low_shift)) | low[v];
    } else {
      q = at[v] + across + at[a];
    }
    at[v] = q;
    finish(v, q);
    if (kColors) color[v] += reinterpret_cast<Uint4>(reinterpret_cast<Int4>(color[b] + 1U + color[a]) >> 1);
  }
  bool inside = true;
  for (int axis = 0; axis < 3; ++axis) inside = inside && lowest[axis] >= -kMaxLattice && highest[axis] <= kMaxLattice;
  return inside;
}

// Predicts normals from the facets, adds the residuals of their codes, and decodes them, in whole groups.
LUMIGRID_ALWAYS_INLINE void reconstructNormals(const PatchHeader& header, const std::uint16_t* indices,
                                               Scratch& scratch, glm::vec3* out) {
  const std::size_t count = groupsOf(header.vertices) * kGroup;
  FacetSum* sums = scratch.facet_sums.data();
  for (std::size_t v = header.vertices; v < count; ++v) sums[v] = {};
  sumFacets(indices, header.triangles, sums);

  std::array<std::int32_t, kNormalBlock> u, w;
  NormalBlock sum;
  NormalBlock unit;
  for (std::size_t first = 0; first < count; first += kNormalBlock) {
    const std::size_t part = std::min(kNormalBlock, count - first);
    for (std::size_t i = 0; i < part; i += 4) {
      const FacetSum* s = sums + first + i;
      const Float4 four[4] = {s[0].sum, s[1].sum, s[2].sum, s[3].sum};
      const auto lanes = base::transposed(four);
      std::memcpy(&sum.z[i], &lanes[0], sizeof(Float4));
      std::memcpy(&sum.x[i], &lanes[1], sizeof(Float4));
      std::memcpy(&sum.y[i], &lanes[2], sizeof(Float4));
    }
    predictNormals(sum, part, u.data(), w.data());
    // Codes count modulo 256, as in the encoder.
    const auto low_byte = [](std::uint32_t n) { return static_cast<std::int32_t>(n << 24) >> 24; };
    for (std::size_t i = 0; i < part; ++i) {
      u[i] = low_byte(static_cast<std::uint32_t>(u[i]) + scratch.normal_u[first + i]);
      w[i] = low_byte(static_cast<std::uint32_t>(w[i]) + scratch.normal_v[first + i]);
    }
    decodeNormals(u.data(), w.data(), part, unit);
    for (std::size_t i = 0; i < part; i += 4) {
      Float4 lanes[4] = {};
      std::memcpy(&lanes[0], &unit.x[i], sizeof(Float4));
      std::memcpy(&lanes[1], &unit.y[i], sizeof(Float4));
      std::memcpy(&lanes[2], &unit.z[i], sizeof(Float4));
      const auto four = base::transposed(lanes);
      // The fourth lane is written over by the next normal.
      for (std::size_t k = 0; k < 4; ++k)
        std::memcpy(reinterpret_cast<std::uint8_t*>(out + first + i + k), &four[k], sizeof(Float4));
    }
  }
}

LUMIGRID_ALWAYS_INLINE void reconstructColors(const PatchHeader& header, const Uint4* codes,
                                              const std::uint32_t* alphas, glm::u8vec4* out) {
  const Uint4 opaque = Uint4{} + 255;
  for (std::size_t v = 0; v < header.vertices; v += 4) {
    const auto [luma, orange, green, unused] = base::transposed(codes + v);
    Uint4 alpha{};
    if (header.hasAlpha()) std::memcpy(&alpha, alphas + v, sizeof(alpha));
    const Uint4 rgba = colorsOfCodes(luma, orange, green, alpha + opaque);
    std::memcpy(&out[v], &rgba, sizeof(rgba));
  }
}

// Three planes of residuals, vertex by vertex: coordinates, or channels. The fourth lane is zero.
LUMIGRID_ALWAYS_INLINE bool readThreePlanes(ResidualReader readPlane, base::ByteView in, std::size_t& at,
                                            std::size_t groups, Scratch& scratch, Uint4* out) {
  const std::size_t padded = groups * kGroup;
  std::array<const std::uint32_t*, 3> plane{};
  for (std::size_t k = 0; k < 3; ++k) {
    std::uint32_t* room = Scratch::room(scratch.planes[k], padded);
    if (!readPlane(in, at, groups, scratch.residualRoom(groups), room)) return false;
    plane[k] = room;
  }
  for (std::size_t v = 0; v < padded; v += 4) {
    Uint4 four[4] = {};
    for (std::size_t k = 0; k < 3; ++k) std::memcpy(&four[k], plane[k] + v, sizeof(Uint4));
    const auto turned = base::transposed(four);
    for (std::size_t k = 0; k < 4; ++k) out[v + k] = turned[k];
  }
  return true;
}

// Decodes the patch; returns what is wrong with its bytes, or null.
LUMIGRID_ALWAYS_INLINE const char* decodeParts(const PatchHeader& header, base::ByteView bytes,
                                               ResidualReader readPlane, ConnectivityReader readTriangles,
                                               PatchGeometry& geometry) {
  // A copy with sixteen bytes behind it, since whole words are read at any place.
  thread_local Scratch scratch;
  std::uint8_t* copy = Scratch::room(scratch.bytes, bytes.size() + 16);
  std::memcpy(copy, bytes.data(), bytes.size());
  std::memset(copy + bytes.size(), 0, 16);
  const base::ByteView in(copy, bytes.size());

  // Triangles, and the gate that each vertex is predicted from.
  std::uint16_t* indices = Scratch::room(scratch.indices, (std::size_t{header.triangles} + kSlack) * 3);
  scratch.front.assign((std::size_t{1} << header.front_bits) + kBehindRing, 0);
  std::uint64_t* gates = Scratch::room(scratch.gates, header.vertices + kSlack);
  const base::ByteView steps = in.subspan(kHeaderBytes, header.stepBytes());
  const base::ByteView escapes = in.subspan(kHeaderBytes + steps.size(), header.escape_bytes);
  if (!readTriangles(header, {steps, escapes}, {scratch.front.data(), indices, gates}))
    return "the triangles do not decode";

  // Residuals.
  const std::size_t groups = groupsOf(header.vertices);
  const std::size_t padded = groups * kGroup;
  Uint4* positions = Scratch::room(scratch.positions, padded);
  const ResidualRoom room = scratch.residualRoom(groups);
  std::size_t at = kHeaderBytes + steps.size() + escapes.size();
  bool whole = readThreePlanes(readPlane, in, at, groups, scratch, positions);
  const bool has_low_bits = header.lowBits() > 0 || kOneLoop;
  if (has_low_bits) {
    const std::span<Uint4> low(Scratch::room(scratch.low_bits, header.vertices), header.vertices);
    if (header.lowBits() == 0)
      std::fill(low.begin(), low.end(), Uint4{});
    else
      whole = whole && readLowBits(in, at, header.lowBits(), low);
  }
  for (std::vector<std::uint32_t>* plane : {&scratch.normal_u, &scratch.normal_v}) {
    std::uint32_t* codes = Scratch::room(*plane, padded);
    if (header.hasNormals())
      whole = whole && readPlane(in, at, groups, room, codes);
    else
      std::fill_n(codes, padded, 0);
  }
  Uint4* colors = header.hasColors() ? Scratch::room(scratch.colors, padded) : nullptr;
  if (header.hasColors()) whole = whole && readThreePlanes(readPlane, in, at, groups, scratch, colors);
  std::uint32_t* alphas = header.hasAlpha() ? Scratch::room(scratch.alphas, padded) : nullptr;
  if (header.hasAlpha()) whole = whole && readPlane(in, at, groups, room, alphas);
  if (!whole || at != bytes.size()) return "the vertices do not decode";

  // Vertices.
  glm::ivec3* points = Scratch::room(scratch.lattice, header.vertices + 1U);
  const bool inside = header.hasColors()
                          ? (has_low_bits ? addPredictions<true, true>(header, gates, scratch, points)
                                          : addPredictions<true, false>(header, gates, scratch, points))
                          : (has_low_bits ? addPredictions<false, true>(header, gates, scratch, points)
                                          : addPredictions<false, false>(header, gates, scratch, points));
  if (!inside) return "a vertex lies outside the lattice";
  glm::vec3* normals = Scratch::room(scratch.normals, padded + 1);
  reconstructNormals(header, indices, scratch, normals);
  geometry.indices.assign(indices, indices + std::size_t{header.triangles} * 3);
  geometry.positions.assign(points, points + header.vertices);
  geometry.normals.assign(normals, normals + header.vertices);
  if (header.hasColors()) {
    glm::u8vec4* rgba = Scratch::room(scratch.rgba, padded);
    reconstructColors(header, colors, alphas, rgba);
    geometry.colors.assign(rgba, rgba + header.vertices);
  }
  return nullptr;
}

#if defined(__x86_64__)
__attribute__((LUMIGRID_AVX2)) const char* decodeByAvx2(const PatchHeader& header, base::ByteView bytes,
                                                        PatchGeometry& geometry) {
  return decodeParts(header, bytes, readResidualsByAvx2, readConnectivityByAvx2, geometry);
}

__attribute__((LUMIGRID_AVX2)) const char* decodeByAvx512(const PatchHeader& header, base::ByteView bytes,
                                                          PatchGeometry& geometry) {
  return decodeParts(header, bytes, readResidualsByAvx512, readConnectivityByAvx2, geometry);
}
#endif

const char* decodeAnywhere(const PatchHeader& header, base::ByteView bytes, PatchGeometry& geometry) {
  return decodeParts(header, bytes, readResiduals, readConnectivity, geometry);
}

using Decoder = const char* (*)(const PatchHeader&, base::ByteView, PatchGeometry&);

Decoder fastestDecoder([[maybe_unused]] bool may_use_avx512) {
#if defined(__x86_64__)
  const bool has_avx2 = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("bmi") != 0 &&
                        __builtin_cpu_supports("bmi2") != 0 && __builtin_cpu_supports("popcnt") != 0;
  const bool has_avx512 = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
                          __builtin_cpu_supports("avx512vbmi2") != 0;
  if (has_avx2) return has_avx512 && may_use_avx512 ? decodeByAvx512 : decodeByAvx2;
#endif
  return decodeAnywhere;
}

base::Result<PatchGeometry> decodeBy(Decoder decode, base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readHeader(bytes));
#if !defined(__EMSCRIPTEN__)
  // All of it is requested from memory before the checksum waits for the first of it.
  for (std::size_t i = 0; i < bytes.size(); i += 64) __builtin_prefetch(bytes.data() + i);
#endif
  if (checksum(bytes) != header.crc) return brokenPatch("checksum does not match");
  PatchGeometry geometry;
  if (const char* fault = decode(header, bytes, geometry)) return brokenPatch(fault);
  return geometry;
}

}  // namespace
}  // namespace codec

base::Result<PatchGeometry> decodePatch(base::ByteView bytes) {
  static const codec::Decoder decoder = codec::fastestDecoder(true);
  return codec::decodeBy(decoder, bytes);
}

base::Result<PatchGeometry> decodePatchByAvx2(base::ByteView bytes) {
  return codec::decodeBy(codec::fastestDecoder(false), bytes);
}

base::Result<PatchGeometry> decodePatchPortably(base::ByteView bytes) {
  return codec::decodeBy(codec::decodeAnywhere, bytes);
}

base::Result<PatchCounts> checkedCounts(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, codec::readHeader(bytes));
  if (codec::checksum(bytes) != header.crc) return codec::brokenPatch("checksum does not match");
  return PatchCounts{header.vertices, header.triangles};
}

base::Result<PatchCounts> encodedCounts(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, codec::readHeader(bytes));
  return PatchCounts{header.vertices, header.triangles};
}

}  // namespace lod::patch
