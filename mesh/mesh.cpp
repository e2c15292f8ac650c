#include "mesh/mesh.h"

namespace mesh {

std::vector<glm::vec3> computeVertexNormals(const Mesh& mesh) {
  // The cross product's length is twice the area, so that plain sums are weighted by area. Sums are double: one vertex
  // may have large and tiny triangles.
  std::vector<glm::dvec3> sums(mesh.positions.size(), glm::dvec3(0.0));
  for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
    const glm::dvec3 a(mesh.positions[mesh.indices[i]]);
    const glm::dvec3 b(mesh.positions[mesh.indices[i + 1]]);
    const glm::dvec3 c(mesh.positions[mesh.indices[i + 2]]);
    const glm::dvec3 normal = glm::cross(b - a, c - a);
    for (std::size_t k = 0; k < 3; ++k) sums[mesh.indices[i + k]] += normal;
  }

  // A vertex without area around it still needs a unit vector.
  std::vector<glm::vec3> normals(sums.size());
  for (std::size_t v = 0; v < sums.size(); ++v) {
    const double length = glm::length(sums[v]);
    normals[v] = length > 0.0 ? glm::vec3(sums[v] / length) : glm::vec3(0.0F, 0.0F, 1.0F);
  }
  return normals;
}

}  // namespace mesh
