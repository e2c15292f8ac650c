#pragma once
// A cut of a built hierarchy as one surface, and how closed it is.
#include <array>
#include <map>
#include <vector>

#include "lod/build/hierarchy_build.h"
#include "lod/patch/traverse.h"
#include "tests/support/surface_distance.h"

namespace support {

/// Small patches, so that small meshes have several levels.
inline lod::build::HierarchyOptions smallPatches() {
  lod::build::HierarchyOptions options;
  options.voxel_triangles = 60;
  options.leaf_triangles = 400;
  options.node_triangles = 200;
  return options;
}

using LatticeEdge = std::array<int, 6>;

/// Directed edges by lattice position that lack an opposite: how many, counted with multiplicity. 0: closed.
inline std::size_t openEdges(const lod::build::BuiltHierarchy& built, const std::vector<std::uint32_t>& patches) {
  std::map<LatticeEdge, int> balance;
  for (const std::uint32_t p : patches) {
    const lod::patch::PatchGeometry& g = built.geometry[p];
    for (std::size_t i = 0; i < g.indices.size(); i += 3)
      for (std::size_t k = 0; k < 3; ++k) {
        const glm::ivec3 a = g.positions[g.indices[i + k]];
        const glm::ivec3 b = g.positions[g.indices[i + (k + 1) % 3]];
        ++balance[{a.x, a.y, a.z, b.x, b.y, b.z}];
        --balance[{b.x, b.y, b.z, a.x, a.y, a.z}];
      }
  }
  std::size_t open = 0;
  for (const auto& [edge, count] : balance) open += static_cast<std::size_t>(count > 0 ? count : 0);
  return open;
}

inline Surface surfaceOf(const lod::build::BuiltHierarchy& built, const std::vector<std::uint32_t>& patches) {
  Surface s;
  for (const std::uint32_t p : patches) {
    const lod::patch::PatchGeometry& g = built.geometry[p];
    const auto base = static_cast<std::uint32_t>(s.positions.size());
    for (const glm::ivec3& q : g.positions) s.positions.push_back(built.hierarchy.lattice.position(q));
    for (const std::uint16_t i : g.indices) s.indices.push_back(base + i);
  }
  return s;
}

inline Surface surfaceOf(const lod::build::Mesh& mesh) {
  return {mesh.positions, mesh.indices};
}

/// Patches of one level: a cut through the whole model.
inline std::vector<std::uint32_t> levelCut(const lod::patch::Hierarchy& h, std::uint32_t level) {
  std::vector<std::uint32_t> patches;
  for (std::uint32_t p = 0; p < h.patches.size(); ++p)
    if (h.patches[p].level == level) patches.push_back(p);
  return patches;
}

}  // namespace support
