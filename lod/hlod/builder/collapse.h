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

struct Collapsed {
  patch::builder::CollapseHistory history;
  float error = 0.0F;  ///< the largest of the samples, at most the limit; lattice steps
};

/// Vertices stay where they are or vanish. Closed surfaces stay closed, open edges move along open edges only, and no
/// triangle turns over. `limit`: lattice steps. `carries`: what the mesh's bounds say counts towards the limit, place
/// by place.
Collapsed collapseWithin(const NodeMesh& mesh, float limit, const AppearanceOptions& options, bool carries = false);

/// Replaces the mesh's triangles by those that are left, and raises `error` by the collapses' and `bounds` by the
/// proven distance between both surfaces.
void applyCollapses(NodeMesh& mesh, Collapsed&& collapsed);

/// The same for a mesh that nothing is made of any more: its `bounds` are dropped, and `error` stays.
void applyLastCollapses(NodeMesh& mesh, Collapsed&& collapsed);

}  // namespace lod::hlod::builder
