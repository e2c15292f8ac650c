#pragma once
// Meshes written as binary PLY files, the way by which meshes made in memory reach a builder.
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "tests/support/mesh.h"

namespace support {

/// Holds world positions and 3 indices per triangle. Attributes are empty, or as many as positions.
struct PlyMesh {
  std::vector<glm::dvec3> positions;
  std::vector<glm::vec3> normals;
  std::vector<glm::u8vec4> colors;
  std::vector<std::uint32_t> indices;
  bool doubles = true;

  PlyMesh() = default;
  /// Takes the mesh's positions, scaled and moved, and its triangles, but no attributes.
  explicit PlyMesh(const Mesh& mesh, double scale = 1.0, const glm::dvec3& at = glm::dvec3(0.0))
      : indices(mesh.indices) {
    for (const glm::vec3& p : mesh.positions) positions.push_back(scale * glm::dvec3(p) + at);
  }
  std::uint32_t add(const glm::dvec3& p) {
    positions.push_back(p);
    return static_cast<std::uint32_t>(positions.size() - 1);
  }
  void add(std::uint32_t a, std::uint32_t b, std::uint32_t c) { indices.insert(indices.end(), {a, b, c}); }
  std::size_t triangles() const { return indices.size() / 3; }
};

inline std::string plyHeader(const PlyMesh& mesh) {
  const std::string type = mesh.doubles ? "double" : "float";
  std::string text = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(mesh.positions.size()) +
                     "\nproperty " + type + " x\nproperty " + type + " y\nproperty " + type + " z\n";
  if (!mesh.normals.empty()) text += "property float nx\nproperty float ny\nproperty float nz\n";
  if (!mesh.colors.empty()) text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  return text + "element face " + std::to_string(mesh.triangles()) +
         "\nproperty list uchar uint vertex_indices\nend_header\n";
}

/// Writes a binary, little-endian file.
inline void writePly(const std::string& path, const PlyMesh& mesh) {
  std::string text = plyHeader(mesh);
  auto put = [&](const auto& value) {
    char bytes[sizeof(value)];
    std::memcpy(bytes, &value, sizeof(value));
    text.append(bytes, sizeof(value));
  };
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    for (int k = 0; k < 3; ++k)
      mesh.doubles ? put(mesh.positions[v][k]) : put(static_cast<float>(mesh.positions[v][k]));
    if (!mesh.normals.empty()) put(mesh.normals[v]);
    if (!mesh.colors.empty()) put(glm::u8vec3(mesh.colors[v]));
  }
  for (std::size_t i = 0; i < mesh.indices.size(); ++i) {
    if (i % 3 == 0) put(std::uint8_t{3});
    put(mesh.indices[i]);
  }
  std::ofstream(path, std::ios::binary) << text;
}

/// Writes the mesh with its normals and colours.
inline void writePly(const std::string& path, const Mesh& mesh) {
  PlyMesh ply(mesh, 1.0, mesh.origin);
  ply.normals = mesh.normals;
  ply.colors = mesh.colors;
  ply.doubles = mesh.origin != glm::dvec3(0.0);
  writePly(path, ply);
}

}  // namespace support
