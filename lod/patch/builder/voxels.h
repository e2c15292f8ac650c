#pragma once
// Sorts triangles into an adaptive voxel space and makes a graph of the voxels (Okamoto 2011, section 4.1, steps 1 and
// 2).
//
// A triangle belongs to the voxel that holds most of its vertices. The median of three Morton codes lies in every cell
// that holds two of them, at every depth. So the median code alone tells the triangle's voxel at each depth of the
// octree, and sorting triangles by it sorts them into voxels of every size at once.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "lod/ingest/morton.h"
#include "lod/patch/builder/partition.h"

namespace lod::patch::builder {

/// One cell of the octree and its triangles: a range of the triangles sorted by median code.
struct Voxel {
  std::uint64_t code = 0;       ///< Morton code of the cell's lowest corner
  std::uint32_t size_bits = 0;  ///< the cell's edge is 2^size_bits lattice steps
  std::uint32_t first = 0;      ///< triangles first … first + count − 1
  std::uint32_t count = 0;      ///< > 0
};

/// Voxels of at most `max_triangles` (a cell of one lattice step may hold more), ascending by code. `sorted`: by
/// radixSort().
std::vector<Voxel> makeVoxels(std::span<const ingest::KeyedIndex> sorted, std::uint32_t bits,
                              std::uint32_t max_triangles);

/// Triangle t has corners indices[3 t] … indices[3 t + 2].
struct TriangleView {
  std::span<const glm::ivec3> positions;
  std::span<const std::uint32_t> indices;
};

enum class TieWeight {
  kNormals,         ///< the inner product of mean normals, mapped to 1 … 16, as in the paper
  kSharedVertices,  ///< the number of mesh vertices that two voxels share, which is the length of the cut
};

/// The boxes of the voxels' triangles, on the lattice.
std::vector<Extent> voxelExtents(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                                 std::span<const Voxel> voxels);

/// The voxels' graph. A vertex weighs as many triangles as it has. Edges join voxels whose cells share a face, and
/// voxels that share a mesh vertex.
Graph voxelGraph(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                 std::span<const Voxel> voxels, std::uint32_t bits, TieWeight weight);

}  // namespace lod::patch::builder
