#pragma once
// A mesh as a PLY file, and a hierarchy file with everything read back.
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/format.h"

namespace support {

/// World positions, 3 indices per triangle.
struct PlyMesh {
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> indices;
  bool doubles = true;

  PlyMesh() = default;
  explicit PlyMesh(const mesh::Mesh& mesh, double scale = 1.0, const glm::dvec3& at = glm::dvec3(0.0))
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

/// Binary, little-endian.
inline void writePly(const std::string& path, const PlyMesh& mesh) {
  const std::string type = mesh.doubles ? "double" : "float";
  std::string text = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(mesh.positions.size()) +
                     "\nproperty " + type + " x\nproperty " + type + " y\nproperty " + type + " z\nelement face " +
                     std::to_string(mesh.triangles()) + "\nproperty list uchar uint vertex_indices\nend_header\n";
  auto put = [&](const auto& value) {
    char bytes[sizeof(value)];
    std::memcpy(bytes, &value, sizeof(value));
    text.append(bytes, sizeof(value));
  };
  for (const glm::dvec3& p : mesh.positions)
    for (int k = 0; k < 3; ++k) mesh.doubles ? put(p[k]) : put(static_cast<float>(p[k]));
  for (std::size_t i = 0; i < mesh.indices.size(); ++i) {
    if (i % 3 == 0) put(std::uint8_t{3});
    put(mesh.indices[i]);
  }
  std::ofstream(path, std::ios::binary) << text;
}

/// Opens, verifies and decodes a hierarchy file; faults fail the test.
inline lod::patch::builder::BuiltHierarchy readBuilt(const std::string& path,
                                                     const lod::patch::builder::HierarchySummary& summary) {
  lod::patch::builder::BuiltHierarchy built;
  built.summary = summary;
  const auto file = lod::patch::PatchFile::open(path);
  EXPECT_TRUE(file) << file.error().message;
  if (!file) return built;
  for (const std::string& fault : file->verify()) ADD_FAILURE() << fault;
  built.hierarchy = file->hierarchy();
  for (std::uint32_t p = 0; p < built.hierarchy.patches.size(); ++p) {
    auto geometry = file->geometry(p);
    EXPECT_TRUE(geometry) << geometry.error().message;
    built.geometry.push_back(geometry ? std::move(*geometry) : lod::patch::PatchGeometry{});
  }
  return built;
}

}  // namespace support
