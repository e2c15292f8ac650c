#pragma once
// These functions make a cut of a built hierarchy one surface, and find its open edges.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "lod/patch/traverse.h"
#include "tests/support/built_hierarchy.h"
#include "tests/support/surface_distance.h"

namespace support {

/// Small patches, so that small meshes have several levels.
inline lod::patch::builder::HierarchyOptions smallPatches() {
  lod::patch::builder::HierarchyOptions options;
  options.voxel_triangles = 60;
  options.leaf_triangles = 400;
  options.node_triangles = 200;
  return options;
}

/// The root mean square of the typical errors of a level, over its triangles.
inline double typicalErrorOf(const lod::patch::Hierarchy& h, std::uint32_t level) {
  double sum = 0.0, triangles = 0.0;
  for (const lod::patch::Patch& patch : h.patches) {
    if (patch.level != level || patch.producer == lod::patch::kNoGroup) continue;
    const double error = h.groups[patch.producer].typical_error;
    sum += patch.triangles * error * error, triangles += patch.triangles;
  }
  return std::sqrt(sum / triangles);
}

/// A directed edge of triangles by the lattice points of its ends, and the patch that has it.
struct LatticeEdge {
  glm::ivec3 from{0}, to{0};
  std::uint32_t patch = 0;
};

/// Returns the directed edges that lack an opposite, each as often as it lacks one, sorted by their ends. A closed
/// surface has none.
inline std::vector<LatticeEdge> unopposed(std::vector<LatticeEdge> edges) {
  auto key = [](const glm::ivec3& q) { return std::array{q.x, q.y, q.z}; };
  struct Run {
    std::array<int, 6> ends;
    std::uint32_t edge;
    int sign;
  };
  std::vector<Run> runs;
  runs.reserve(edges.size());
  for (std::uint32_t i = 0; i < edges.size(); ++i) {
    auto a = key(edges[i].from), b = key(edges[i].to);
    const int sign = a < b ? 1 : -1;
    if (sign < 0) std::swap(a, b);
    runs.push_back({{a[0], a[1], a[2], b[0], b[1], b[2]}, i, sign});
  }
  std::sort(runs.begin(), runs.end(),
            [](const Run& a, const Run& b) { return a.ends != b.ends ? a.ends < b.ends : a.edge < b.edge; });
  std::vector<LatticeEdge> out;
  for (std::size_t begin = 0, end = 0; begin < runs.size(); begin = end) {
    int balance = 0;
    for (end = begin; end < runs.size() && runs[end].ends == runs[begin].ends; ++end) balance += runs[end].sign;
    for (std::size_t i = begin; i < end && balance != 0; ++i)
      if (runs[i].sign * balance > 0) out.push_back(edges[runs[i].edge]), balance -= runs[i].sign;
  }
  return out;
}

inline std::vector<LatticeEdge> openEdgesOf(const BuiltHierarchy& built, const std::vector<std::uint32_t>& patches) {
  std::vector<LatticeEdge> edges;
  for (const std::uint32_t p : patches) {
    const lod::patch::PatchGeometry& g = built.geometry[p];
    for (std::size_t i = 0; i < g.indices.size(); ++i)
      edges.push_back({g.positions[g.indices[i]], g.positions[g.indices[i % 3 == 2 ? i - 2 : i + 1]], p});
  }
  return unopposed(std::move(edges));
}

/// Returns the number of directed edges without an opposite.
inline std::size_t openEdges(const BuiltHierarchy& built, const std::vector<std::uint32_t>& patches) {
  return openEdgesOf(built, patches).size();
}

/// In the world, as meshes of tests are.
inline Surface surfaceOf(const BuiltHierarchy& built, const std::vector<std::uint32_t>& patches) {
  const glm::vec3 origin(built.summary.origin);
  Surface s;
  for (const std::uint32_t p : patches) {
    const lod::patch::PatchGeometry& g = built.geometry[p];
    const auto base = static_cast<std::uint32_t>(s.positions.size());
    for (const glm::ivec3& q : g.positions) s.positions.push_back(origin + built.hierarchy.lattice.position(q));
    for (const std::uint16_t i : g.indices) s.indices.push_back(base + i);
  }
  return s;
}

inline Surface surfaceOf(const Mesh& mesh) {
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
