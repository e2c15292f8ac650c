#pragma once
// The work on a block of cells: first the class and normal of each point, then, when those of all blocks are known, the
// umbrellas and chunks of each leaf.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "lod/pmr/builder/class_store.h"
#include "lod/pmr/builder/octree.h"
#include "lod/pmr/format.h"

namespace lod::pmr::builder {

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

/// A leaf and its chunks, in the order of their numbers (lod/pmr/chunk_order.h).
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
