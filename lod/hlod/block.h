#pragma once
// The picture of a node, or its caster, as bytes (docs/formats/hlod.md, "Blocks"). Triangles are coded as patches
// (lod/patch/codec.h), points as those of a pmr.lgm (lod/pmr/chunks.h).
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/hlod/format.h"

namespace lod::hlod {

/// A vertex of a triangle, or a point. Its place is in steps of 2^step_bits lattice steps.
struct NodeVertex {
  glm::ivec3 place{0};
  glm::vec3 normal{0.0F, 0.0F, 1.0F};  ///< unit; +z in casters
  glm::u8vec3 color{255};              ///< sRGB; white where the file has no colours, and in casters
};

struct NodeGeometry {
  std::vector<NodeVertex> vertices;      ///< of the triangles
  std::vector<std::uint32_t> triangles;  ///< three vertices each, counter-clockwise from outside
  /// Two vertices each: the edges of only one triangle, along which the neighbouring cell or another level may leave a
  /// crack, so that they are drawn as lines (section 4).
  std::vector<std::uint32_t> edges;
  std::vector<NodeVertex> points;
};

struct BlockOptions {
  bool colors = false;
  bool is_caster = false;  ///< neither normals nor colours are stored
};

/// Nothing becomes no bytes. Triangles, vertices, edges and points may be reordered, triangles and edges turned, and
/// vertices that no triangle uses are left out; a vertex that triangles of two pieces use comes back twice. Vertices at
/// one place of different attributes stay apart. Normals and colours are rounded (lod/patch/codec.h, lod/pmr/chunks.h).
/// The caller sees to: counts up to kMaxPrimitives, places within the lattice, each edge once and of a triangle, and
/// neither points nor edges in casters.
base::Bytes encodeBlock(const NodeGeometry& geometry, const BlockOptions& options);
/// Whether the checksum is right for these bytes and the counts of this row.
bool isIntact(base::ByteView bytes, const Node& row, const BlockOptions& options);
/// `row`: the counts that the table states. Errors: kInvalidInput for a damaged block.
base::Result<NodeGeometry> decodeBlock(base::ByteView bytes, const Node& row, const BlockOptions& options);

}  // namespace lod::hlod
