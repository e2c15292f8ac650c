#pragma once
// Small mesh files written for one test, and what a test asks of the mesh that was read.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/support/mesh_reader.h"
#include "tests/support/temporary_directory.h"

namespace mesh_files {

using support::Mesh;
using support::MeshFile;

/// A directory of this process, so that tests can run side by side.
inline const support::TemporaryDirectory& directory() {
  static const support::TemporaryDirectory directory;
  return directory;
}

/// Writes a new file and returns its path.
inline std::string write(const std::string& name, const std::string& bytes) {
  std::string path = directory() / name;
  std::ofstream(path, std::ios::binary) << bytes;
  return path;
}

/// Reads a file of these bytes.
inline base::Result<MeshFile> read(const std::string& name, const std::string& bytes) {
  const std::string path = write(name, bytes);
  auto result = support::readMesh(path);
  std::remove(path.c_str());
  return result;
}

/// The error line of bytes that must be refused; empty, and a failed test, where they are read.
inline std::string errorOf(const std::string& name, const std::string& bytes) {
  auto result = read(name, bytes);
  if (result) {
    ADD_FAILURE() << name << " was read";
    return {};
  }
  EXPECT_EQ(result.error().message.find('\n'), std::string::npos) << "more than one line";
  EXPECT_NE(result.error().message.find(name), std::string::npos) << "the line does not name the file";
  return result.error().message;
}

template <class T>
void put(std::string& bytes, T value, bool big_endian = false) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof(T));
  if (big_endian) std::reverse(raw.begin(), raw.end());
  bytes.append(raw.data(), raw.size());
}

/// How many triangles run along each directed edge.
inline std::map<std::pair<std::uint32_t, std::uint32_t>, int> directedEdges(const Mesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3)
    for (std::size_t k = 0; k < 3; ++k) ++edges[{mesh.indices[i + k], mesh.indices[i + (k + 1) % 3]}];
  return edges;
}

/// Whether every edge is run along once in each direction.
inline bool isClosed(const Mesh& mesh) {
  const auto edges = directedEdges(mesh);
  return std::all_of(edges.begin(), edges.end(), [&](const auto& e) {
    return e.second == 1 && edges.contains({e.first.second, e.first.first});
  });
}

/// Whether the mesh is the unit square, as two triangles that face upwards.
inline void expectSquare(const base::Result<MeshFile>& result) {
  ASSERT_TRUE(result) << result.error().message;
  const Mesh& mesh = result->mesh;
  ASSERT_EQ(mesh.positions.size(), 4U);
  const std::vector<std::uint32_t> two_triangles{0, 1, 2, 0, 2, 3};
  EXPECT_EQ(mesh.indices, two_triangles);
  const std::array<glm::dvec3, 4> corners{{{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {1.0, 1.0, 0.0}, {0.0, 1.0, 0.0}}};
  for (std::size_t v = 0; v < 4; ++v)
    EXPECT_LT(glm::distance(glm::dvec3(mesh.positions[v]) + mesh.origin, corners[v]), 1e-6) << v;
  ASSERT_EQ(mesh.normals.size(), 4U);
  for (const glm::vec3& n : mesh.normals) EXPECT_LT(glm::distance(n, glm::vec3(0.0F, 0.0F, 1.0F)), 1e-6F);
}

inline double signedVolume(const Mesh& mesh) {
  double volume = 0.0;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const auto p = [&](std::size_t k) { return glm::dvec3(mesh.positions[mesh.indices[i + k]]); };
    volume += glm::dot(p(0), glm::cross(p(1), p(2))) / 6.0;
  }
  return volume;
}

/// The points of a file as they come, of which support::readMesh() would make a mesh.
struct Cloud {
  std::vector<glm::dvec3> positions;
  std::vector<glm::u8vec4> colors;
  std::vector<glm::vec3> normals;
  mesh::StreamedFile file;
};

/// Reads a cloud of these bytes.
inline base::Result<Cloud> readCloud(const std::string& bytes, const std::string& name) {
  const std::string path = write(name, bytes);
  support::WholeMesh whole;
  mesh::StreamOptions options;
  options.accepts_points = true;
  auto read = mesh::streamMesh(path, whole, options);
  std::remove(path.c_str());
  if (!read) return read.error();
  return Cloud{std::move(whole.positions), std::move(whole.colors), std::move(whole.normals), std::move(*read)};
}

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace mesh_files
