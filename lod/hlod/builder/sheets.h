#pragma once
// Small sheets become points for good. A sheet is a set of triangles that hang together by edges of exactly two of
// them. Collapses cannot take the last triangles of a sheet away, so soup, specks of noise and surfaces that are
// nowhere manifold would keep a triangle for each of their sheets up to the root, however small it is there.
#include "lod/hlod/builder/node_mesh.h"

namespace lod::hlod::builder {

/// Replaces each sheet by points whose box has a diagonal of at most `size` and whose triangles have errors of at most
/// `room` (lattice steps). A sheet that ends at a crack goes on in a neighbouring cell, and stays.
void replaceSmallSheets(NodeMesh& mesh, float size, float room);

/// A triangle of that circumradius in place of each point, facing as it does.
void addFacets(NodeMesh& mesh, float radius);

}  // namespace lod::hlod::builder
