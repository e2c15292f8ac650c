#pragma once
// Makes one node of the octree from what lies below it (Guthe et al. 2004, section 3).
#include <cstdint>
#include <span>
#include <vector>

#include "lod/hlod/builder/appearance.h"
#include "lod/hlod/builder/node_mesh.h"
#include "lod/hlod/format.h"
#include "lod/ingest/border_vertices.h"

namespace lod::hlod::builder {

struct NodeOptions {
  Lattice lattice;
  bool colors = false;
  AppearanceOptions appearance;
  bool points = true;
  float resolution = 128.0F;  ///< as in BuildOptions
};

/// A node with its blocks, and the picture's triangles, from which nodes above are made.
struct BuiltNode {
  Node row;  ///< without links; its box and errors are those of its own geometry alone
  base::Bytes picture, caster;
  NodeMesh mesh;               ///< nothing for a leaf
  std::uint32_t vertices = 0;  ///< of the triangles that a node above is made of
  bool has_too_many = false;   ///< more than kMaxPrimitives of something: there are no blocks
};

/// The source's own triangles, three corners each; colours are left out unless `colors`.
NodeMesh sourceMesh(std::span<const ingest::Corner> corners, bool colors);

/// Vertices at one lattice point become one with the mean of their attributes. Cracks between parts that were
/// simplified are closed. The parts, at most 64, lose their memory. Returns their largest error with them.
NodeMesh mergeParts(std::vector<NodeMesh>& parts);

BuiltNode makeLeaf(const NodeMesh& mesh, const NodeOptions& options);
/// `edge`: of the node's cell, lattice steps. `parts`: the pictures' triangles that the node is made of; they lose
/// their memory. The caster is the picture's triangles, simplified further: appearance no longer counts; a small
/// triangle stands there for each point of the mesh.
BuiltNode makeInnerNode(float edge, std::vector<NodeMesh>& parts, const NodeOptions& options);

/// A cone that contains both.
base::NormalCone mergedCone(const base::NormalCone& a, const base::NormalCone& b);

}  // namespace lod::hlod::builder
