#pragma once
// Triangles sorted into an adaptive voxel space, and the voxels as a graph (Okamoto 2011, section 4.1, steps 1 and 2).
//
// A triangle belongs to the voxel that holds most of its vertices. Of three Morton codes the median lies in every cell
// that holds two of them, at every depth; so the median code alone names the triangle's voxel at each depth of the
// octree, and sorting triangles by it sorts them into voxels of every size at once.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "lod/build/partition.h"

namespace lod::build {

/// Most bits per axis of a lattice point: three of them fill a 63-bit Morton code.
inline constexpr std::uint32_t kMaxLatticeBits = 21;

// Of each byte, two zero bits put before each of its bits.
inline constexpr std::array<std::uint32_t, 256> kSpreadBytes = [] {
  std::array<std::uint32_t, 256> spread{};
  for (std::uint32_t byte = 0; byte < spread.size(); ++byte)
    for (std::uint32_t bit = 0; bit < 8; ++bit) spread[byte] |= (byte >> bit & 1U) << (3 * bit);
  return spread;
}();

// The way back: every third bit, from the lowest on.
inline std::uint64_t gatherBits(std::uint64_t x) {
  x &= 0x1249249249249249;
  x = (x | x >> 2) & 0x10c30c30c30c30c3;
  x = (x | x >> 4) & 0x100f00f00f00f00f;
  x = (x | x >> 8) & 0x1f0000ff0000ff;
  x = (x | x >> 16) & 0x1f00000000ffff;
  return (x | x >> 32) & 0x1fffff;
}

/// Bits of x, y and z interleaved, x lowest. Coordinates 0 … 2^21 − 1.
inline std::uint64_t mortonCode(const glm::ivec3& q) {
  const auto bits = [&q](int first, int mask) -> std::uint64_t {
    const auto spread = [&](int x) { return kSpreadBytes[static_cast<std::size_t>(x >> first & mask)]; };
    return spread(q.x) | spread(q.y) << 1 | spread(q.z) << 2;
  };
  return bits(0, 255) | bits(8, 255) << 24 | bits(16, 31) << 48;
}
inline glm::ivec3 mortonPoint(std::uint64_t code) {
  return {static_cast<int>(gatherBits(code)), static_cast<int>(gatherBits(code >> 1)),
          static_cast<int>(gatherBits(code >> 2))};
}
/// The code that names a triangle's voxel: the median of its vertices' codes.
inline std::uint64_t medianCode(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

struct KeyedIndex {
  std::uint64_t key = 0;
  std::uint32_t index = 0;
};
/// Stable sort by the lowest `key_bits` bits of the key.
void radixSort(std::vector<KeyedIndex>& items, std::uint32_t key_bits);

/// One cell of the octree and its triangles: a range of the triangles sorted by median code.
struct Voxel {
  std::uint64_t code = 0;       ///< Morton code of the cell's lowest corner
  std::uint32_t size_bits = 0;  ///< the cell's edge is 2^size_bits lattice steps
  std::uint32_t first = 0;      ///< triangles first … first + count − 1
  std::uint32_t count = 0;      ///< > 0
};

/// Voxels of at most `max_triangles` (a cell of one lattice step may hold more), ascending by code. `sorted` as
/// radixSort left it.
std::vector<Voxel> makeVoxels(std::span<const KeyedIndex> sorted, std::uint32_t bits, std::uint32_t max_triangles);

/// Triangles over vertices, as voxelGraph looks at them: triangle t has corners indices[3 t …].
struct TriangleView {
  std::span<const glm::ivec3> positions;
  std::span<const std::uint32_t> indices;
};

enum class TieWeight {
  kNormals,         ///< inner product of mean normals, mapped to 1 … 16 (the paper)
  kSharedVertices,  ///< how many mesh vertices two voxels share: the length of the cut
};

/// The boxes of the voxels' triangles, on the lattice.
std::vector<Extent> voxelExtents(const TriangleView& triangles, std::span<const KeyedIndex> sorted,
                                 std::span<const Voxel> voxels);

/// The voxels' graph. Vertex weight: triangles. Edges: adjacency over a cell's face; voxels that share a mesh vertex
/// where cells touch diagonally only.
Graph voxelGraph(const TriangleView& triangles, std::span<const KeyedIndex> sorted, std::span<const Voxel> voxels,
                 std::uint32_t bits, TieWeight weight);

}  // namespace lod::build
