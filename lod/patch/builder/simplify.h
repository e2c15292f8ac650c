#pragma once
// Edge collapse by quadric error (Garland, Heckbert 1997) of one group's triangles, with part of the vertices locked.
//
// Works on any set of triangles: open, non-manifold, soup. A collapse is a vertex map, so it keeps every closed surface
// closed in the sense that counts here: each directed edge has its opposite equally often. The only triangles ever
// removed are those that lost their area to a collapse, and pairs that came to lie on each other with opposite sides.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
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

struct Simplified {
  std::vector<std::uint32_t> indices;   ///< 3 per triangle, into the group's vertices
  std::vector<std::uint32_t> origin;    ///< per triangle: which of the group's triangles it was
  std::vector<std::uint32_t> survivor;  ///< per vertex: the vertex it was collapsed into (itself when it lives)
  bool rough = false;                   ///< more than the first stage was needed
};

/// A group at some number of triangles: its vertices as they are then (no triangles, nothing locked), and which are
/// left.
struct SimplifiedGroup {
  GroupMesh vertices;
  Simplified simplified;
};

/// Collapses edges, cheapest first, until at most `target_triangles` (≥ 1) are left or nothing can be collapsed. Moves
/// surviving vertices to the best lattice point and gives them colours and normals from between (normals are not
/// normalised).
///
/// Stage 1 keeps topology (link condition) and orientation, and lets border vertices move along the border only. Stage
/// 2, where stage 1 could go on only by moving the surface far, drops the conditions on topology and borders; stage 3
/// those on orientation too, so that soup and tiny components shrink whatever it costs. What vanishes (a component, a
/// flap, an ear) does so only at the price of its distance to what stays. Locked vertices stay in all stages.
Simplified simplifyGroup(GroupMesh& mesh, std::size_t target_triangles);

/// The same with the edges and fans of the mesh, where the caller has them.
SimplifiedGroup simplifyGroup(const GroupMesh& mesh, const FacetSurface& surface, std::size_t target_triangles);

}  // namespace lod::patch::builder
