#pragma once
// Cuts triangles into patches (Okamoto 2011, section 4.1, step 2), and fills in the patches' records.
#include <cstdint>
#include <span>
#include <vector>

#include "lod/patch/builder/voxels.h"
#include "lod/patch/builder/work_store.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch::builder {

/// Above the leaves a triangle carries errorCode() of SurfaceError's toward, from and color from level to level.
inline constexpr std::size_t kErrorCodes = 3;
inline constexpr std::size_t kErrorBytes = kErrorCodes * sizeof(std::uint16_t);

/// A surface on the lattice. Morton codes identify its vertices.
struct CodedMesh {
  std::vector<glm::ivec3> positions;
  std::vector<std::uint64_t> codes;    ///< codes of the positions; no two are equal
  std::vector<glm::vec3> normals;      ///< as stored (quantised)
  std::vector<glm::u8vec4> colors;     ///< empty, or as stored
  std::vector<std::uint32_t> indices;  ///< 3 per triangle

  TriangleView view() const { return {positions, indices}; }
};

/// The triangles, sorted by the voxels that they belong to.
std::vector<ingest::KeyedIndex> sortedByVoxel(const CodedMesh& mesh, std::uint32_t bits);

/// Divides the triangles into parts of at most `max_triangles`: the graph of voxels of at most `voxel_triangles` is
/// bisected until no part is larger. Returns the triangle numbers of each part.
std::vector<std::vector<std::uint32_t>> splitTriangles(const CodedMesh& mesh,
                                                       std::span<const ingest::KeyedIndex> sorted, std::uint32_t bits,
                                                       std::uint32_t voxel_triangles, std::uint32_t max_triangles,
                                                       TieWeight weight);

/// Encodes the parts as patches of a level. `outer[v]` != 0: patches that are not among the parts may share the vertex.
/// Such vertices and those that parts share are listed as border. `carried`: as many bytes for each triangle of the
/// mesh, which travel with it, or empty.
std::vector<NewPatch> makePatches(const CodedMesh& mesh, const std::vector<std::vector<std::uint32_t>>& parts,
                                  std::span<const std::uint8_t> outer, base::ByteView carried, const Lattice& lattice,
                                  std::uint32_t level);

}  // namespace lod::patch::builder
