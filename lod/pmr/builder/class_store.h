#pragma once
// The classes of all points, as the first pass over the blocks decides them.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/pmr/builder/octree.h"

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

}  // namespace lod::pmr::builder
