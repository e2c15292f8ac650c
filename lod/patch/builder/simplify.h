#pragma once
// Edge collapse by quadric error (Garland and Heckbert 1997, "Surface Simplification Using Quadric Error Metrics") of
// one group's triangles, with part of the vertices locked.
//
// It works on any set of triangles: open, non-manifold, soup. A collapse is a map of vertices, so it keeps every closed
// surface closed in this sense: each directed edge has its opposite equally often. Triangles are removed only when a
// collapse took their area, or when two came to lie on each other with opposite sides.
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "lod/patch/builder/facet_surface.h"

namespace lod::patch::builder {

/// The merged triangles of a group. Positions are lattice points relative to some corner of the group: whole numbers
/// below 2^22, exact in float. Colours are 0 … 255; empty when the mesh has none.
struct GroupMesh {
  std::vector<glm::vec3> positions;
  std::vector<glm::vec3> normals;      ///< as many as positions; unit or zero
  std::vector<glm::vec3> colors;       ///< empty, or as many as positions
  std::vector<std::uint8_t> locked;    ///< as many as positions; 1: shared with another group, stays as it is
  std::vector<std::uint32_t> indices;  ///< 3 per triangle
};

/// Which triangles of a group are left, and where its vertices went.
struct CollapseHistory {
  std::vector<std::uint32_t> indices;   ///< 3 per triangle, into the group's vertices
  std::vector<std::uint32_t> origin;    ///< per triangle: which of the group's triangles it was
  std::vector<std::uint32_t> survivor;  ///< per vertex: the vertex it was collapsed into (itself when it lives)
  bool rough = false;                   ///< more than the first stage was needed
};

/// A group after its collapses. `vertices` has all vertices of the group, the surviving ones where they were moved to,
/// without triangles and locks.
struct SimplifiedGroup {
  GroupMesh vertices;
  CollapseHistory history;
};

/// Collapses edges, cheapest first, until at most `target_triangles` (≥ 1) are left or nothing can be collapsed. Moves
/// surviving vertices to the best lattice point and interpolates their colours and normals along the edge (normals are
/// not normalised). `surface`: the mesh with its edges and fans.
///
/// Stage 1 keeps topology (link condition) and orientation, and lets border vertices move along the border only. Stage
/// 2 begins where stage 1 could go on only by moving the surface far, and drops the conditions on topology and borders.
/// Stage 3 drops that on orientation too, so that soup and tiny components shrink whatever it costs. A component, flap
/// or ear that vanishes costs its distance to what remains. Locked vertices stay in all stages.
SimplifiedGroup simplifyGroup(const GroupMesh& mesh, const FacetSurface& surface, std::size_t target_triangles);

}  // namespace lod::patch::builder
