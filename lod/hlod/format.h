#pragma once
// hlod.lgh: an octree of which each node holds the surface of its cell within a stated error, as triangles and points
// (Guthe, Borodin, Balázs and Klein 2004, section 3; docs/formats/hlod.md).
//
// Nodes are numbered breadth first from the root, 0, and along the Morton curve within a level, so the children of a
// node lie side by side. A leaf holds the source's own triangles; a cut draws a node in place of all its children. Each
// node has a picture, which keeps the appearance of the surface, and a caster, which keeps its shape alone and throws
// shadows.
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/geometry.h"
#include "lod/lattice.h"

namespace lod::hlod {

/// Lattice coordinates are 0 … 2^kPositionBits. The last of them is there for coarse steps, which round up to it.
inline constexpr std::uint32_t kPositionBits = 21;
inline constexpr std::int32_t kLatticeEnd = 1 << kPositionBits;
inline constexpr std::uint32_t kMaxDepth = kPositionBits;
/// Most triangles, points and open edges of a node, each.
inline constexpr std::uint32_t kMaxPrimitives = 1U << 22;
/// Most bytes of a block.
inline constexpr std::uint32_t kMaxBlockBytes = 1U << 27;

struct Header {
  std::uint64_t file_bytes = 0;
  std::uint64_t source_triangles = 0;  ///< those of all leaves
  std::uint32_t nodes = 0;             ///< 1 or more
  bool colors = false;
  Lattice lattice;
  glm::ivec3 low{0}, high{0};     ///< the box of all geometry, lattice points: 0 … kLatticeEnd
  base::Sphere bounds;            ///< around that box, from which it follows; scene-local
  std::uint32_t table_bytes = 0;  ///< length of the table, which follows the header
};

/// Where the bytes of a node's picture or caster lie.
struct BlockPlace {
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0;
};

/// A row of the table.
struct Node {
  /// Contains the geometry of the node and of all below it; scene-local.
  base::Aabb box;
  /// Contains the normals of the source's triangles below.
  base::NormalCone cone;
  /// ε of the picture, scene units: each place of the source's surface, with its appearance, is at most so far from a
  /// place of the picture of the same appearance (section 3.1). 0 for leaves; at least that of each child.
  float error = 0.0F;
  /// A proven bound of the distance between the source's surface and the picture's triangles, both ways, points
  /// replaced by the triangles that they stand for; scene units. 0 for leaves; at least that of each child. It may be
  /// larger than `error`, which is measured at the vertices of what the node was made of.
  float shape_error = 0.0F;
  /// ε of the caster, whose appearance does not count. 0 for leaves; at least that of each child.
  float caster_error = 0.0F;
  std::uint32_t first_child = 0;  ///< above the node's own number; 0 without children
  std::uint8_t children = 0;      ///< 0 … 8
  std::uint8_t step_bits = 0;     ///< 0 … 20; picture and caster lie at multiples of 2^step_bits lattice steps
  std::uint32_t triangles = 0, points = 0, edges = 0;  ///< of the picture; edges: those where cracks may open
  std::uint32_t caster_triangles = 0;                  ///< 0 for leaves
  BlockPlace picture;                                  ///< of nothing: no bytes
  /// A leaf's caster is its picture, and has no bytes of its own.
  BlockPlace caster;

  bool isLeaf() const { return children == 0; }
};

/// Length of the header: fixed.
inline constexpr std::uint32_t kHeaderBytes = 128;
/// A table has at least so many bytes for each node, so a short damaged one cannot claim many nodes.
inline constexpr std::uint32_t kMinNodeBytes = 4;

/// A sphere around the box.
base::Sphere boundsOf(const glm::ivec3& low, const glm::ivec3& high, const Lattice& lattice);

/// The error for a damaged file: `problem`, and what to do.
base::Error damaged(const std::string& problem);

/// Reads the header from the file's front. Errors: kVersion for an unknown version; kInvalidInput for a file that is no
/// hlod.lgh, cut short, damaged or contradictory.
base::Result<Header> readHeader(base::ByteView front);
base::Bytes headerBytes(const Header& header);

/// Reads the table, of header.table_bytes bytes. Errors: kInvalidInput where it is damaged or contradicts itself or the
/// header.
base::Result<std::vector<Node>> readTable(const Header& header, base::ByteView table);
/// Encodes the table, and sets what the header says of it: the nodes, the box with its bounds, and the length; the
/// header's lattice is known before. The places' offsets are ignored: they follow from the lengths. Boxes and cones
/// grow a little, and errors are rounded up by at most 1 %; those of parents are made to contain those of their
/// children. The caller sees to: one node or more, boxes that are not empty, no errors and no casters of leaves, and
/// the bounds of docs/formats/hlod.md.
base::Bytes tableBytes(const std::vector<Node>& nodes, Header& header);
/// Sets the places' offsets, and file_bytes of the header, from header.table_bytes and the lengths: behind the table
/// come the pictures of all nodes in their order, then the casters of all.
void placeBlocks(Header& header, std::vector<Node>& nodes);

}  // namespace lod::hlod
