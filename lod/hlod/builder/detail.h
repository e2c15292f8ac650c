#pragma once
// Detail finer than a node's error: attributes are smoothed there before the node is simplified, so that the shading
// does not alias (Guthe et al. 2004, section 3.1), and its small triangles become points (section 3.2).
#include <cstdint>
#include <limits>

#include "lod/hlod/block.h"
#include "lod/hlod/builder/appearance.h"
#include "lod/hlod/builder/node_mesh.h"

namespace lod::hlod::builder {

/// Replaces normals and colours of vertices by the mean of their own and their neighbours', where no edge around them
/// is longer than `size` (lattice steps). Returns how far that moved attributes along the surface: half of the longest
/// edge around a vertex of which one that counts changed by more than is negligible; 0 where none did.
float smoothDetail(NodeMesh& mesh, float size, const AppearanceOptions& appearance);

struct PictureOptions {
  /// Triangles become points whose corners are all at most this far from their barycentre (lattice steps); 0: none do.
  float triangle_reach = 0.0F;
  /// Points within a cell of a grid of this size that face alike are one.
  float cell = 1.0F;
  /// Triangles of larger errors (NodeMesh::errorOf) stay triangles.
  float room = std::numeric_limits<float>::infinity();
  bool edges = true;  ///< open edges are listed
};

/// Errors are those before places are rounded, in lattice steps.
struct Picture : NodeGeometry {
  float points_error = 0.0F;  ///< the largest distance of what points stand for from them
  /// How far beside the triangles that remain rounding left what it flattened or turned over.
  float flattened = 0.0F;
};

/// The node's picture in steps of 2^step_bits lattice steps. A small triangle becomes its corners and the middles of
/// its edges (figure 3), clustered with the mesh's points. Open edges of the triangles that remain are the picture's
/// edges, but for those of the source's own border. Places that would lie outside the lattice are moved to its end.
Picture makePicture(const NodeMesh& mesh, std::uint32_t step_bits, const PictureOptions& options);

}  // namespace lod::hlod::builder
