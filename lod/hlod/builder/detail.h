#pragma once
// Detail finer than a node's error: attributes are smoothed there before the node is simplified, so that the shading
// does not alias (Guthe et al. 2004, section 3.1), and its small triangles become points (section 3.2).
#include <cstdint>

#include "lod/hlod/block.h"
#include "lod/hlod/builder/node_mesh.h"

namespace lod::hlod::builder {

/// Replaces normals and colours of vertices by the mean of their own and their neighbours', where no edge around them
/// is longer than `size` (lattice steps).
void smoothDetail(NodeMesh& mesh, float size);

struct PictureOptions {
  /// Triangles become points whose corners are all at most this far from their barycentre (lattice steps); 0: none do.
  float triangle_reach = 0.0F;
  /// Points within a cell of a grid of this size that face alike are one, with the mean of their attributes.
  float cell = 1.0F;
  bool edges = true;  ///< open edges are listed
};

/// The node's picture in steps of 2^step_bits lattice steps. A small triangle becomes its corners and the middles of
/// its edges (figure 3), clustered. Open edges of the triangles that remain are the picture's edges, but for those
/// of the source's own border. Vertices that would lie outside the lattice's 2^21 steps are moved to its border.
NodeGeometry makePicture(const NodeMesh& mesh, std::uint32_t step_bits, const PictureOptions& options);

}  // namespace lod::hlod::builder
