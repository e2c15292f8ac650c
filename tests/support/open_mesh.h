#pragma once
// Mesh files read by OpenMesh, which knows nothing of our readers.
#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <optional>
#include <string>

#include "tests/support/mesh.h"

namespace support {

/// Positions and triangles; nothing where OpenMesh cannot read the file. It gives triangles that would make the mesh
/// non-manifold vertices of their own.
inline std::optional<Mesh> readByOpenMesh(const std::string& path) {
  OpenMesh::TriMesh_ArrayKernelT<> read;
  if (!OpenMesh::IO::read_mesh(read, path)) return std::nullopt;
  Mesh mesh;
  for (const auto v : read.vertices())
    mesh.positions.emplace_back(read.point(v)[0], read.point(v)[1], read.point(v)[2]);
  for (const auto f : read.faces())
    for (const auto v : read.fv_range(f)) mesh.indices.push_back(static_cast<std::uint32_t>(v.idx()));
  return mesh;
}

inline double areaOf(const Mesh& mesh) {
  double area = 0.0;
  for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
    const auto p = [&](std::size_t k) { return glm::dvec3(mesh.positions[mesh.indices[i + k]]); };
    area += 0.5 * glm::length(glm::cross(p(1) - p(0), p(2) - p(0)));
  }
  return area;
}

}  // namespace support
