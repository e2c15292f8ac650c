#pragma once
// The mesh that builders work on.
#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <string>
#include <vector>

#include "base/geometry.h"

namespace mesh {

/// Indexed triangles in scene-local float32, with the double origin they are relative to.
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

/// How often each repair was made while importing; names are stable (they appear in `info --json`).
struct RepairCounts {
  std::map<std::string, std::uint64_t>
      counts;  ///< e.g. "welded_vertices", "degenerate_triangles", "duplicate_triangles",
               ///< "split_non_manifold_vertices", "unreferenced_vertices"
  void add(const std::string& what, std::uint64_t n) {
    if (n > 0) counts[what] += n;
  }
};

/// Area-weighted vertex normals from the triangles (angle-weighted where the vertex is sharp is not attempted).
std::vector<glm::vec3> computeVertexNormals(const Mesh& mesh);

}  // namespace mesh
