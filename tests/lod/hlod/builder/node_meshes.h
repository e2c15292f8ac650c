#pragma once
// Makes the builder's meshes from those of tests.
#include <cmath>
#include <glm/glm.hpp>

#include "lod/hlod/builder/appearance.h"
#include "lod/hlod/builder/node_mesh.h"
#include "tests/support/mesh.h"
#include "tests/support/surface_distance.h"

namespace support {

/// Puts the mesh on a lattice of `steps` steps along its longest side. Normals are those of the facets around.
inline lod::hlod::builder::NodeMesh nodeMesh(const Mesh& mesh, float steps) {
  lod::hlod::builder::NodeMesh node;
  base::Aabb box;
  for (const glm::vec3& p : mesh.positions) box.add(p);
  const glm::vec3 size = box.size();
  const float scale = steps / std::max({size.x, size.y, size.z});
  for (const glm::vec3& p : mesh.positions) node.positions.push_back(glm::round((p - box.min) * scale));
  node.normals.assign(node.positions.size(), glm::vec3(0.0F));
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const auto at = [&](std::size_t k) { return node.positions[mesh.indices[i + k]]; };
    const glm::vec3 n = glm::cross(at(1) - at(0), at(2) - at(0));
    for (std::size_t k = 0; k < 3; ++k) node.normals[mesh.indices[i + k]] += n;
  }
  for (glm::vec3& n : node.normals) n = glm::length(n) > 0.0F ? glm::normalize(n) : glm::vec3(0.0F, 0.0F, 1.0F);
  for (const glm::u8vec4& c : mesh.colors) node.colors.emplace_back(c.r, c.g, c.b);
  node.on_rim.assign(node.positions.size(), 0);
  node.indices = mesh.indices;
  return node;
}

inline Surface surfaceOf(const lod::hlod::builder::NodeMesh& mesh) {
  Surface surface{mesh.positions, mesh.indices};
  for (glm::vec3& p : surface.positions) p += glm::vec3(mesh.corner);
  return surface;
}

/// A place of a surface, or a corner of a triangle.
struct SurfacePlace {
  glm::vec3 position{0.0F};
  glm::vec3 normal{0.0F, 0.0F, 1.0F};
  glm::vec3 color{0.0F};
};

inline lod::hlod::builder::FourPoints fourOf(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c,
                                             const glm::vec3& d) {
  using lod::hlod::builder::Four;
  return {Four{a.x, b.x, c.x, d.x}, Four{a.y, b.y, c.y, d.y}, Four{a.z, b.z, c.z, d.z}};
}

/// ε² of the place and the triangle abc, which stands in each lane with another corner first.
inline lod::hlod::builder::Four errors2(const SurfacePlace& place, const SurfacePlace& a, const SurfacePlace& b,
                                        const SurfacePlace& c, const lod::hlod::builder::AppearanceOptions& options) {
  using namespace lod::hlod::builder;
  const auto four = [](const SurfacePlace& p, const SurfacePlace& q, const SurfacePlace& r) {
    return FourAttributes{fourOf(p.position, q.position, r.position, p.position),
                          fourOf(p.normal, q.normal, r.normal, p.normal), fourOf(p.color, q.color, r.color, p.color)};
  };
  const FourAppearances triangles(four(a, b, c), four(b, c, a), four(c, a, b), options);
  const Attributes at{lod::hlod::builder::fourOf(place.position), lod::hlod::builder::fourOf(place.normal),
                      lod::hlod::builder::fourOf(place.color)};
  return triangles.error2(at, options);
}

}  // namespace support
