#pragma once
// Mesh files read whole into memory: vertices at one position become one, and nothing else is repaired.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "mesh/generate/sample.h"
#include "mesh/stream_mesh.h"
#include "tests/support/mesh.h"
#include "tests/support/scratch_directory.h"

namespace support {

struct MeshFile {
  Mesh mesh;  ///< with normals, computed where the file gives none
  mesh::StreamedFile file;
};

/// Keeps all that a reader hands on. Attributes of corners are averaged at their vertex.
class WholeMesh : public mesh::MeshSink {
 public:
  base::Result<void> vertices(const mesh::VertexBlock& block) override {
    const std::size_t first = positions.size();
    positions.insert(positions.end(), block.positions.begin(), block.positions.end());
    if (!block.normals.empty()) {
      normals.resize(first, glm::vec3(0.0F));
      normals.insert(normals.end(), block.normals.begin(), block.normals.end());
    }
    if (!block.colors.empty()) {
      colors.resize(first, glm::u8vec4(255));
      colors.insert(colors.end(), block.colors.begin(), block.colors.end());
    }
    return {};
  }
  base::Result<void> triangles(const mesh::TriangleBlock& block) override {
    for (const std::uint64_t corner : block.corners) indices.push_back(static_cast<std::uint32_t>(corner));
    for (std::size_t i = 0; i < block.normals.size(); ++i) {
      const auto v = static_cast<std::size_t>(block.corners[i]);
      normals.resize(std::max(normals.size(), v + 1), glm::vec3(0.0F));
      normals[v] += block.normals[i];
    }
    for (std::size_t i = 0; i < block.colors.size(); ++i) {
      if (block.colors[i].a == 0) continue;
      const auto v = static_cast<std::size_t>(block.corners[i]);
      corner_colors_.resize(std::max(corner_colors_.size(), v + 1), glm::uvec4(0));
      corner_colors_[v] += glm::uvec4(glm::uvec3(block.colors[i]), 1);
    }
    return {};
  }
  base::Result<void> restart() override {
    *this = WholeMesh();
    return {};
  }

  /// Makes as many attributes as positions, and unit normals.
  void finish() {
    if (!normals.empty()) normals.resize(positions.size(), glm::vec3(0.0F));
    for (glm::vec3& n : normals) {
      const float length = glm::length(n);
      n = std::isfinite(length) && length > 0.0F ? n / length : glm::vec3(0.0F);
    }
    if (!colors.empty() || !corner_colors_.empty()) colors.resize(positions.size(), glm::u8vec4(255));
    for (std::size_t v = 0; v < corner_colors_.size(); ++v)
      if (const glm::uvec4& sum = corner_colors_[v]; sum.a > 0)
        colors[v] = glm::u8vec4(glm::u8vec3((glm::uvec3(sum) + sum.a / 2U) / sum.a), 255);
  }

  std::vector<glm::dvec3> positions;
  std::vector<glm::vec3> normals;
  std::vector<glm::u8vec4> colors;
  std::vector<std::uint32_t> indices;

 private:
  std::vector<glm::uvec4> corner_colors_;  // sums, and how many
};

/// 0 where float32 holds every coordinate; else the middle of the box, in whole units.
inline glm::dvec3 originOf(const std::vector<glm::dvec3>& positions) {
  const auto fits = [](const glm::dvec3& p) { return glm::dvec3(glm::vec3(p)) == p; };
  if (std::all_of(positions.begin(), positions.end(), fits)) return glm::dvec3(0.0);
  glm::dvec3 low = positions[0], high = positions[0];
  for (const glm::dvec3& p : positions) low = glm::min(low, p), high = glm::max(high, p);
  const glm::dvec3 middle = 0.5 * (low + high);
  const bool near = glm::length(middle) <= glm::length(high - low);
  return near ? glm::dvec3(0.0) : glm::round(middle);
}

/// For each position the number of the first vertex that lies there. Sorted, since maps of millions take minutes.
inline std::vector<std::uint32_t> firstAtPosition(const std::vector<glm::vec3>& positions) {
  std::vector<std::uint32_t> order(positions.size());
  for (std::uint32_t v = 0; v < order.size(); ++v) order[v] = v;
  // Bits compare well even where a broken file gives NaN.
  const auto key = [&](std::uint32_t v) { return std::bit_cast<std::array<std::uint32_t, 3>>(positions[v]); };
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return key(a) != key(b) ? key(a) < key(b) : a < b; });
  std::vector<std::uint32_t> first(positions.size());
  for (std::size_t i = 0; i < order.size(); ++i)
    first[order[i]] = i > 0 && key(order[i]) == key(order[i - 1]) ? first[order[i - 1]] : order[i];
  return first;
}

/// Vertices numbered in their order, those at one position once; triangles that name a vertex twice go.
inline void weld(const WholeMesh& from, Mesh& mesh) {
  const std::vector<std::uint32_t> first = firstAtPosition(mesh.positions);
  std::vector<std::uint32_t> number(first.size());
  std::uint32_t kept = 0;
  for (std::uint32_t v = 0; v < first.size(); ++v) {
    if (first[v] != v) continue;
    mesh.positions[kept] = mesh.positions[v];
    if (!from.normals.empty()) mesh.normals.push_back(from.normals[v]);
    if (!from.colors.empty()) mesh.colors.push_back(from.colors[v]);
    number[v] = kept++;
  }
  mesh.positions.resize(kept);
  for (std::size_t i = 0; i + 2 < from.indices.size(); i += 3) {
    const std::uint32_t a = number[first[from.indices[i]]], b = number[first[from.indices[i + 1]]],
                        c = number[first[from.indices[i + 2]]];
    if (a != b && b != c && c != a) mesh.indices.insert(mesh.indices.end(), {a, b, c});
  }
}

inline base::Result<MeshFile> readMesh(const std::string& path) {
  MeshFile out;
  WholeMesh whole;
  LUMIGRID_ASSIGN_OR_RETURN(out.file, mesh::streamMesh(path, whole, {}));
  whole.finish();
  out.mesh.origin = originOf(whole.positions);
  for (const glm::dvec3& p : whole.positions) out.mesh.positions.emplace_back(p - out.mesh.origin + 0.0);  // no −0
  weld(whole, out.mesh);
  if (out.mesh.normals.empty()) {
    out.mesh.normals = vertexNormals(out.mesh);
  } else {
    const std::vector<glm::vec3> computed = vertexNormals(out.mesh);
    for (std::size_t v = 0; v < computed.size(); ++v)
      if (out.mesh.normals[v] == glm::vec3(0.0F)) out.mesh.normals[v] = computed[v];
  }
  return out;
}

/// The generated mesh, read back from the file that `lumigrid sample` writes. Empty when it cannot be made.
inline Mesh makeSample(const mesh::generate::SampleOptions& options) {
  const ScratchDirectory scratch;
  const std::string path = scratch / "sample.ply";
  if (!mesh::generate::writeSamplePly(options, path)) return {};
  auto file = readMesh(path);
  return file ? std::move(file->mesh) : Mesh();
}

}  // namespace support
