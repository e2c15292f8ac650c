#pragma once
// The points in the order of their Morton codes, in one file, and the octree over them (Dey and Hudson 2002, section 2,
// "Spatial decomposition").
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <string>
#include <vector>

#include "lod/ingest/point_tiles.h"
#include "lod/lattice.h"
#include "lod/pmr/format.h"

namespace lod::pmr::builder {

/// A box of the lattice.
struct LatticeBox {
  glm::ivec3 low{0}, high{0};

  bool contains(const glm::ivec3& p) const {
    return glm::all(glm::greaterThanEqual(p, low)) && glm::all(glm::lessThanEqual(p, high));
  }
  bool contains(const LatticeBox& other) const { return contains(other.low) && contains(other.high); }
  /// Whether they have more than a side in common.
  bool overlaps(const LatticeBox& other) const {
    return glm::all(glm::lessThan(low, other.high)) && glm::all(glm::greaterThan(high, other.low));
  }
  bool touches(const LatticeBox& other) const {
    return glm::all(glm::lessThanEqual(low, other.high)) && glm::all(glm::greaterThanEqual(high, other.low));
  }
  /// The box and a half of its edges on each side.
  LatticeBox withSurroundings() const {
    const glm::ivec3 half = (high - low) / 2;
    return {low - half, high + half};
  }
};
/// The octree's cell of this depth whose lowest lattice point has this Morton code.
LatticeBox cellBox(std::uint64_t code, std::uint32_t depth);

/// A leaf of the octree. Codes and cells are of the scene's lattice.
struct OctreeCell {
  std::uint64_t first = 0;  ///< its points in the order of codes
  std::uint32_t count = 0;
  std::uint32_t depth = 0;  ///< as in Leaf
  std::uint64_t code = 0;   ///< as in Leaf

  std::int32_t edge() const { return std::int32_t{1} << (kPositionBits - depth); }
  LatticeBox box() const { return cellBox(code, depth); }
};

/// A source point. All at one point of the source's lattice are one, with the mean of their colours and normals.
struct OrderedPoint {
  std::uint64_t code = 0;
  std::uint32_t normal = 0;  ///< as ingest::packNormal; 0 where unknown
  std::uint32_t color = 0;   ///< R G B from the lowest byte
};

class OrderedPoints {
 public:
  /// Writes `directory`/ordered from the tiles, and divides the octree. The lattice becomes coarser than that of the
  /// tiles where this is much finer than the points are dense; of points that fall together then, which are hardly any,
  /// one stays. Errors: kNoSpace, kIo, kCancelled.
  static base::Result<OrderedPoints> order(const ingest::PointTiles& tiles, const Lattice& lattice,
                                           const std::string& directory, const std::function<bool(double)>& progress);
  /// The tables to store beside the file; open() reads both again. Errors: kIo, damaged work files.
  base::Bytes encodeTables() const;
  static base::Result<OrderedPoints> open(const std::string& directory, base::ByteView state);

  const std::vector<OctreeCell>& cells() const { return cells_; }
  const Lattice& lattice() const { return lattice_; }
  std::uint64_t points() const { return points_; }
  /// Whether the source told a normal for each point.
  bool haveNormals() const { return has_normals_; }
  /// Reads the points of a cell. Safe from several threads. Errors: kIo.
  base::Result<std::vector<OrderedPoint>> read(const OctreeCell& cell) const;
  void release() { file_.release(0, file_.size()); }

 private:
  ingest::SpoolFile file_;
  std::vector<OctreeCell> cells_;
  Lattice lattice_;
  std::uint64_t points_ = 0;
  bool has_normals_ = false;
};

/// Cells that are worked on together, and those around them.
struct CellBlock {
  std::uint32_t first = 0, end = 0;   ///< cells
  std::vector<std::uint32_t> around;  ///< other cells that touch the surroundings of one of the block's
};
/// Divides the cells, in their order, into blocks of about this many points. It does not depend on the memory there is,
/// since the result must not.
inline constexpr std::uint64_t kBlockPoints = 240'000;
std::vector<CellBlock> makeBlocks(const std::vector<OctreeCell>& cells);

}  // namespace lod::pmr::builder
