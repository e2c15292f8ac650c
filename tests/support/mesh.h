#pragma once
// Holds an indexed mesh in memory. The product streams its meshes; tests and benchmarks hold theirs whole, as a second
// way.
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "base/geometry.h"

namespace support {

/// Triangles with float32 positions relative to a double origin.
struct Mesh {
  glm::dvec3 origin{0.0};              ///< world position of local (0, 0, 0)
  std::vector<glm::vec3> positions;    ///< local
  std::vector<glm::vec3> normals;      ///< empty, or as many as positions; unit
  std::vector<glm::u8vec4> colors;     ///< empty, or as many as positions; sRGB, a = 255
  std::vector<std::uint32_t> indices;  ///< 3 per triangle, counter-clockwise from outside

  std::size_t triangleCount() const { return indices.size() / 3; }
  base::Aabb box() const {
    base::Aabb b;
    for (const auto& p : positions) b.add(p);
    return b;
  }
};

/// Area-weighted vertex normals; +z where a vertex has no area around it.
inline std::vector<glm::vec3> vertexNormals(const Mesh& mesh) {
  // The cross product's length is twice the area, so plain sums are weighted by area.
  std::vector<glm::dvec3> sums(mesh.positions.size(), glm::dvec3(0.0));
  for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
    const glm::dvec3 a(mesh.positions[mesh.indices[i]]);
    const glm::dvec3 b(mesh.positions[mesh.indices[i + 1]]);
    const glm::dvec3 c(mesh.positions[mesh.indices[i + 2]]);
    for (std::size_t k = 0; k < 3; ++k) sums[mesh.indices[i + k]] += glm::cross(b - a, c - a);
  }
  std::vector<glm::vec3> normals(sums.size());
  for (std::size_t v = 0; v < sums.size(); ++v) {
    const double length = glm::length(sums[v]);
    normals[v] = length > 0.0 ? glm::vec3(sums[v] / length) : glm::vec3(0.0F, 0.0F, 1.0F);
  }
  return normals;
}

}  // namespace support
