#pragma once
// The mesh on the scene's quantisation lattice: where the hierarchy starts from (DESIGN section 4).
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "base/error.h"
#include "lod/build/mesh.h"
#include "lod/build/voxels.h"
#include "lod/patch/hierarchy.h"

namespace lod::build {

/// Vertices ascend in Morton order and no two share a lattice point; triangles ascend by their voxels.
struct LatticeMesh {
  lod::patch::Lattice lattice;
  std::uint32_t bits = 0;              ///< per axis
  std::vector<glm::ivec3> positions;   ///< 0 … 2^bits − 1
  std::vector<glm::vec3> normals;      ///< as stored (lod::patch::quantizedNormal)
  std::vector<glm::u8vec4> colors;     ///< empty, or as many as positions
  std::vector<KeyedIndex> sorted;      ///< triangles by median code; index t: corners indices[3 t …]
  std::vector<std::uint32_t> indices;  ///< 3 per triangle
  RepairCounts repairs;                ///< "lattice_welded_vertices", "lattice_collapsed_triangles"

  TriangleView view() const { return {positions, indices}; }
};

/// Bits along the longest side so that one step is at most 1/16 of the mean edge (the geometric mean, which a few giant
/// triangles do not raise), within 10 … 21.
std::uint32_t chooseLatticeBits(const Mesh& mesh);

/// Rounds every vertex to the lattice, welds those that meet there (colours and normals averaged) and drops triangles
/// that lose their area so. All vertices at one point become one, so a closed mesh stays closed. `bits` 0 chooses. An
/// error when an index or position is no good, or no triangle is left.
base::Result<LatticeMesh> latticeMesh(const Mesh& mesh, std::uint32_t bits);

}  // namespace lod::build
