#pragma once
// pmr.lgm: an octree whose leaves hold points in eleven levels, and the umbrella triangles of each level (Dey and
// Hudson 2002, section 2, "Records"; docs/formats/pmr.md).
//
// Level 0 has all points; level L = 1 … 10 those that decimation with the threshold ρ = L / 10 leaves, so each level is
// part of the finer one. A point's class is the coarsest level that it is part of. A leaf's points lie in one chunk for
// each class, its triangles in one chunk for each level.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/geometry.h"
#include "lod/lattice.h"

namespace lod::pmr {

inline constexpr std::uint32_t kLevels = 11;
inline constexpr std::uint32_t kCoarsest = kLevels - 1;
/// Most own points of a leaf (section 2, "Spatial decomposition": between 8000 and 12000).
inline constexpr std::uint32_t kMaxLeafPoints = 12'000;
/// Most points that a leaf's triangles can refer to, own and foreign ones.
inline constexpr std::uint32_t kMaxVertices = 65'535;
/// Most triangles of a level of a leaf.
inline constexpr std::uint32_t kMaxTriangles = 4 * kMaxVertices;
/// Lattice coordinates are 0 … 2^kPositionBits − 1.
inline constexpr std::uint32_t kPositionBits = 21;
/// Most bytes of a chunk.
inline constexpr std::uint32_t kMaxChunkBytes = 1U << 23;

/// The threshold ρ that made a level (lod/pmr/builder/decimate.h); 0 for level 0.
inline constexpr float thresholdOf(std::uint32_t level) {
  return 0.1F * static_cast<float>(level);
}

struct Header {
  std::uint64_t file_bytes = 0;
  std::uint64_t points = 0;  ///< of all leaves
  std::uint32_t leaves = 0;
  bool colors = false;
  bool oriented = false;  ///< normals point to the outside; otherwise they have no sign, and are seen from both sides
  Lattice lattice;        ///< of the positions
  base::Sphere bounds;    ///< of all points, scene-local
  std::uint32_t table_bytes = 0;  ///< length of the leaf table, which follows the header
  std::uint64_t base_bytes = 0;   ///< length of the base section, which follows the table: the coarsest level
};

/// A class and level of a leaf.
struct LevelRow {
  std::uint32_t points = 0;     ///< own points of this class
  std::uint32_t foreign = 0;    ///< points of other leaves that triangles of this level use, but those of no coarser
  std::uint32_t triangles = 0;  ///< of this level
  /// Mean umbrella radius of the level's own points that have triangles, scene units, but at least that of the finer
  /// level; the edge of the leaf's cell where there is none. Above 0.
  float radius = 0.0F;
  std::uint32_t point_bytes = 0;     ///< length of the chunk of the class; a chunk of nothing has no bytes
  std::uint32_t triangle_bytes = 0;  ///< length of the chunk of the level
  std::uint64_t point_offset = 0;    ///< where the chunks lie in the file
  std::uint64_t triangle_offset = 0;
};

struct Leaf {
  std::uint64_t code = 0;   ///< Morton code of the octree cell's lowest lattice point
  std::uint32_t depth = 0;  ///< of the octree cell, whose edge is 2^(kPositionBits − depth) lattice points
  base::Aabb box;           ///< of all points that it draws, foreign ones included; scene-local
  std::array<LevelRow, kLevels> levels;

  /// Own points of the level, and all that the level can use; foreign points count from their class on.
  std::uint32_t pointsAt(std::uint32_t level) const;
  std::uint32_t verticesAt(std::uint32_t level) const;
};

/// Length of the header: fixed.
inline constexpr std::uint32_t kHeaderBytes = 128;
/// A table has at least so many bytes for each leaf, so a short damaged one cannot claim many leaves.
inline constexpr std::uint32_t kMinLeafBytes = 8;
/// The error for a damaged file: `problem`, and what to do.
base::Error damaged(const std::string& problem);

/// Reads the header from the file's front. Errors: kVersion for an unknown version; kInvalidInput for a file that is no
/// pmr.lgm, cut short, damaged or contradictory.
base::Result<Header> readHeader(base::ByteView front);
base::Bytes headerBytes(const Header& header);

/// Reads the table, of header.table_bytes bytes, in the order of the leaves' codes. Errors: kInvalidInput where it is
/// damaged or contradicts itself or the header.
base::Result<std::vector<Leaf>> readTable(const Header& header, base::ByteView table);
/// Encodes the table, of at least kMinLeafBytes for each leaf. The leaves' offsets are ignored: they follow from the
/// lengths of the chunks. Boxes grow to a coarser lattice, and radii are rounded by about 1 %.
base::Bytes tableBytes(const std::vector<Leaf>& leaves, const Lattice& lattice);
/// Sets the leaves' offsets, and base_bytes and file_bytes of the header, from header.table_bytes and the lengths of
/// the chunks.
void placeChunks(Header& header, std::vector<Leaf>& leaves);

}  // namespace lod::pmr
