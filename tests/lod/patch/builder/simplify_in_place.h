#pragma once
// simplifyGroup() for tests that need no surface of their own.
#include <utility>

#include "lod/patch/builder/facet_surface.h"
#include "lod/patch/builder/simplify.h"

namespace lod::patch::builder {

/// Moves the mesh's vertices as the collapses do; its indices stay.
inline CollapseHistory simplifyInPlace(GroupMesh& mesh, std::size_t target_triangles) {
  FacetSurface surface;
  surface.reset({mesh.positions, mesh.indices});
  SimplifiedGroup simplified = simplifyGroup(mesh, surface, target_triangles);
  mesh.positions = std::move(simplified.vertices.positions);
  mesh.normals = std::move(simplified.vertices.normals);
  mesh.colors = std::move(simplified.vertices.colors);
  return std::move(simplified.history);
}

}  // namespace lod::patch::builder
