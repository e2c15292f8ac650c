#pragma once
// Simplifies the triangles of a node by half-edge collapses within an error that counts appearance as well as shape
// (Guthe et al. 2004, section 3.1; the way in which the error is found is that of Klein, Liebich and Strasser 1996,
// "Mesh Reduction with Error Control").
//
// Each vertex that went is kept as a sample of the surface on one of the triangles near it. A collapse may happen where
// all samples of the triangles that it changes find a place of their appearance within the limit on the new ones.
#include "lod/hlod/builder/appearance.h"
#include "lod/hlod/builder/node_mesh.h"

namespace lod::hlod::builder {

/// The earlier errors of triangles that count towards the limit, place by place.
enum class Carried : std::uint8_t {
  kErrors,  ///< NodeMesh::errorOf()
  kBounds,  ///< NodeMesh::bounds
};

struct Collapsed {
  patch::builder::CollapseHistory history;
  /// The largest error of the samples on each triangle that is left, with what the triangles on which they lay
  /// carried; lattice steps.
  std::vector<float> errors;
};

/// Vertices stay where they are or vanish. Closed surfaces stay closed, open edges move along open edges only, and no
/// triangle turns over. `limit`: lattice steps.
Collapsed collapseWithin(const NodeMesh& mesh, float limit, const AppearanceOptions& options,
                         Carried carried = Carried::kErrors);

/// Replaces the mesh's triangles by those that are left, with their errors, and raises `bounds` by the proven distance
/// between both surfaces. The errors that triangles carried counted towards the limit.
void applyCollapses(NodeMesh& mesh, Collapsed&& collapsed);

/// The same for a mesh that nothing is made of any more: its `bounds` are dropped, and `error` stays.
void applyLastCollapses(NodeMesh& mesh, Collapsed&& collapsed);

}  // namespace lod::hlod::builder
