#pragma once
// Cleaning of an indexed mesh. Private to lod/build; importMeshes() calls it. Every repair is counted; no triangle is
// lost but degenerate and duplicate ones.
#include "mesh/mesh.h"

namespace mesh {

/// In place, in this order:
///  1. weld_distance ≥ 0: vertices closer than that (0: at the same position) become one; colours and normals are
///  averaged.
///     weld_distance < 0: no welding.                                                        "welded_vertices"
///  2. triangles with a repeated corner or collinear corners go                              "degenerate_triangles"
///  3. of triangles with the same three corners, in either winding, the first stays          "duplicate_triangles"
///  4. connected parts that can be wound alike are, after their majority                     "flipped_triangles"
///     those that can't (a Möbius strip) are cut where the winding changes                   "non_orientable_parts"
///  5. edges of three and more triangles                                                     "non_manifold_edges"
///     and vertices of several fans are cut apart by doubling vertices "split_non_manifold_vertices"
///  6. vertices of no triangle go                                                            "unreferenced_vertices"
/// Positions must be finite, indices in range, at most kMaxVertices / kMaxTriangles (soup.h) of them. Normals may be
/// empty, or hold zero vectors where unknown; known ones are unit afterwards.
void repairMesh(Mesh& mesh, double weld_distance, RepairCounts& counts);

}  // namespace mesh
