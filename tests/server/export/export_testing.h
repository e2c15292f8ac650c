#pragma once
// A small scene to export, and what was written read back by the project's own reader of meshes.
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "mesh/stream_mesh.h"
#include "server/export/surface.h"
#include "tests/support/built_hierarchy.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/test_meshes.h"

namespace export_testing {

/// A scene of a mesh, with patches so small that there are several levels of several groups.
inline server::exports::ExportScene exportScene(const support::Mesh& mesh, const std::string& path,
                                                const glm::dvec3& moved = glm::dvec3(0.0)) {
  lod::patch::builder::HierarchyOptions options;
  options.voxel_triangles = 60;
  options.leaf_triangles = 300;
  options.node_triangles = 200;
  support::Mesh placed = mesh;
  placed.origin = moved;
  const auto built = support::buildHierarchy(placed, options, path);
  EXPECT_TRUE(built) << built.error().message;
  server::exports::ExportScene scene;
  scene.scene.origin = built->origin;
  scene.scene.box_min = built->box_min;
  scene.scene.box_max = built->box_max;
  scene.scene.has_colors = built->has_colors;
  scene.scene.light.mode = built->has_colors ? base::LightMode::kUnlit : base::LightMode::kSoft;
  scene.patches = *lod::patch::PatchFile::open(path);
  return scene;
}

inline support::WholeMesh readBack(const std::string& path) {
  support::WholeMesh whole;
  const auto read = mesh::streamMesh(path, whole, {});
  EXPECT_TRUE(read) << read.error().message;
  whole.finish();
  return whole;
}

/// Undoes the turn of y up to z up that 3D Tiles ask of a GLB.
inline glm::dvec3 sceneFromGltf(const glm::dvec3& p) {
  return {p.x, -p.z, p.y};
}

using Corner = std::array<double, 3>;
inline Corner cornerOf(const glm::dvec3& p) {
  return {p.x + 0.0, p.y + 0.0, p.z + 0.0};  // no −0
}

/// Collects triangles of several files, whose vertices are one where their numbers are equal.
struct Surface {
  /// An edge from the smaller corner to the larger: how often a triangle runs along it, and how often against it.
  std::map<std::pair<Corner, Corner>, std::array<int, 2>> edges;
  double area = 0.0;
  std::size_t triangles = 0;

  void add(const support::WholeMesh& mesh, bool gltf) {
    for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
      std::array<glm::dvec3, 3> p;
      for (std::size_t k = 0; k < 3; ++k) {
        p[k] = mesh.positions[mesh.indices[i + k]];
        if (gltf) p[k] = sceneFromGltf(p[k]);
      }
      area += 0.5 * glm::length(glm::cross(p[1] - p[0], p[2] - p[0]));
      ++triangles;
      for (std::size_t k = 0; k < 3; ++k) {
        const Corner a = cornerOf(p[k]), b = cornerOf(p[(k + 1) % 3]);
        ++edges[std::minmax(a, b)][a < b ? 0 : 1];
      }
    }
  }
  /// Edges that do not have one triangle on each side. A closed surface has none; two equal surfaces in one place, a
  /// hole, or a fold, each give some.
  std::size_t faults() const {
    std::size_t count = 0;
    for (const auto& [edge, uses] : edges)
      if (uses != std::array<int, 2>{1, 1}) ++count;
    return count;
  }
};

}  // namespace export_testing
