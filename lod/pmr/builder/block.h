#pragma once
// The work on a block of cells: first the class and normal of each point, then, when those of all blocks are known, the
// umbrellas and chunks of each leaf.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/pmr/builder/octree.h"
#include "lod/pmr/format.h"

namespace lod::pmr::builder {

/// A point as the first pass leaves it.
struct PointClass {
  std::uint8_t coarsest = 0;  ///< its class
  glm::u8vec2 normal{0};      ///< encodeNormal
};
static_assert(sizeof(PointClass) == 3);

/// The classes of all points on disk, which is also the journal of the blocks that are done.
class ClassStore {
 public:
  /// Creates `path`, or with `resume` reads and continues it. `cells` and `blocks` must outlive it. Errors: kNoSpace,
  /// kIo.
  static base::Result<ClassStore> open(const std::string& path, bool resume, const std::vector<OctreeCell>& cells,
                                       const std::vector<CellBlock>& blocks);
  bool has(std::size_t block) const { return offsets_[block].has_value(); }
  /// Safe from several threads.
  base::Result<void> add(std::uint32_t block, std::span<const PointClass> classes);
  /// Reads the classes of a cell's points. Safe from several threads. Errors: kIo.
  base::Result<std::vector<PointClass>> read(std::uint32_t cell) const;

 private:
  ingest::RecordLog log_;
  const std::vector<OctreeCell>* cells_ = nullptr;
  const std::vector<CellBlock>* blocks_ = nullptr;
  std::vector<std::optional<std::uint64_t>> offsets_;  // by block, of its first class
  std::vector<std::uint32_t> block_of_;                // by cell
};

/// The points of a block and those around it, within half the edge of its nearest cell. A polygon whose corners are
/// within a quarter of the edge is not cut by anything farther away.
struct LoadedBlock {
  std::vector<OrderedPoint> points;   ///< own points in order, then the others by cell
  std::vector<std::uint32_t> cell;    ///< of each
  std::vector<std::uint32_t> number;  ///< of each, within its cell
  std::size_t own = 0;
  std::vector<glm::dvec3> places;  ///< lattice points
};
base::Result<LoadedBlock> loadBlock(const OrderedPoints& points, const CellBlock& block);

/// Triangulates a block and decimates it. Returns the classes of its own points. Errors: kIo.
base::Result<std::vector<PointClass>> classify(const OrderedPoints& points, const CellBlock& block);

/// A leaf and its chunks, in the order of a file: points and triangles of the coarsest level, then the points of all
/// other classes, then the triangles of all other levels.
struct BuiltLeaf {
  Leaf leaf;
  std::uint64_t unused = 0;  ///< points that no triangle of level 0 uses
  base::Bytes chunks;
};
base::Result<std::vector<BuiltLeaf>> makeLeaves(const OrderedPoints& points, const ClassStore& classes,
                                                const CellBlock& block, bool colors);

/// Memory that either pass takes for a point, own or around, while it works; measured.
inline constexpr std::uint64_t kBlockBytesPerPoint = 1000;

}  // namespace lod::pmr::builder
