#pragma once
// Closes the cracks between parts of a node that were simplified each by itself (Guthe et al. 2004, section 3: the
// generalised pair contractions of vertices with edges).
//
// The open edges of two neighbours are parts of one line of the source's, of which each side kept other vertices. So a
// vertex that one side kept is put into the edge of the other that passes it by.
#include <cstdint>
#include <span>

#include "lod/hlod/builder/node_mesh.h"

namespace lod::hlod::builder {

/// `parts`: for each vertex the parts of the node whose triangles use it, a bit each. A vertex on an open edge is put
/// into the open edges of other parts that pass it at most `reach` away (lattice steps), unless a triangle would turn
/// over. The bounds and errors of the triangles that change grow by the distance. Returns how many were put in.
std::size_t closeCracks(NodeMesh& mesh, std::span<const std::uint64_t> parts, float reach);

}  // namespace lod::hlod::builder
