#pragma once
// Triangles sorted into an adaptive voxel space, and the voxels as a graph (Okamoto 2011, section 4.1, steps 1 and 2).
//
// A triangle belongs to the voxel that holds most of its vertices. Of three Morton codes the median lies in every cell
// that holds two of them, at every depth; so the median code alone names the triangle's voxel at each depth of the
// octree, and sorting triangles by it sorts them into voxels of every size at once.
#include <algorithm>
#include <cstddef>
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

/// Voxels of at most `max_triangles` (a cell of one lattice step may hold more), ascending by code. `sorted` as
/// radixSort left it.
std::vector<Voxel> makeVoxels(std::span<const ingest::KeyedIndex> sorted, std::uint32_t bits,
                              std::uint32_t max_triangles);

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
std::vector<Extent> voxelExtents(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                                 std::span<const Voxel> voxels);

/// The voxels' graph. Vertex weight: triangles. Edges: adjacency over a cell's face; voxels that share a mesh vertex
/// where cells touch diagonally only.
Graph voxelGraph(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                 std::span<const Voxel> voxels, std::uint32_t bits, TieWeight weight);

}  // namespace lod::patch::builder
