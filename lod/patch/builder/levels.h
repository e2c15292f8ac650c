#pragma once
// The levels of the hierarchy, bottom up: patches grouped, groups merged, simplified and split (DESIGN section 4, step
// 3). Geometry lies in the store; memory holds a record per patch and, for the level at hand, the border vertices.
//
// A vertex is known by its Morton code. One on the border between groups is locked and stays as it is; any other
// belongs to one group alone, which may move it. So groups of a level are independent pieces of work, and patches that
// meet share vertices by code.
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "lod/ingest/buckets.h"
#include "lod/patch/builder/distance_bound.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/builder/work_store.h"

namespace lod::patch::builder {

struct WorkGroup {
  lod::patch::Group record;             ///< bounds, errors, level
  std::vector<std::uint32_t> consumed;  ///< work numbers of patches
  std::vector<std::uint32_t> produced;
};

class LevelBuilder {
 public:
  /// `advance(triangles)` is told about finished work from any one thread at a time; false cancels.
  LevelBuilder(const ingest::SourceLattice& lattice, const HierarchyOptions& options, WorkStore& store,
               std::function<bool(std::uint64_t)> advance);

  /// What the store held already: taken instead of being made again.
  void know(const WorkUnit& unit, std::vector<WorkPatch> patches);
  /// All levels up to a single root patch, from the leaves, bucket by bucket. Errors: kCancelled, those of the store.
  base::Result<void> makeLevels(std::vector<WorkPatch> leaves);

  std::vector<WorkPatch>& patches() { return patches_; }
  const std::vector<WorkGroup>& groups() const { return groups_; }
  const std::vector<LevelSummary>& levels() const { return levels_; }

 private:
  struct Piece {
    std::vector<std::uint32_t> consumed;  // work numbers of patches
    std::vector<std::uint64_t> locked;    // codes of the vertices shared with other groups
  };
  struct Made {
    lod::patch::Group record;
    ErrorHistogram errors;
    std::vector<WorkPatch> produced;
    std::optional<std::vector<Outlier>> outliers;  // unknown of what an earlier run made
  };
  /// What a group that stands out is made again with.
  struct Again {
    float allowed = 0.0F;  // lattice steps
    std::optional<std::vector<Outlier>> outliers;
  };
  struct SharedVertex {
    std::uint64_t code = 0;
    std::uint32_t patch = 0;  // place in the level
  };

  base::Result<std::vector<SharedVertex>> sharedVertices(std::span<const std::uint32_t> level) const;
  std::vector<std::uint32_t> groupOfPatches(std::span<const std::uint32_t> level, std::span<const SharedVertex> shared,
                                            std::uint32_t& groups) const;
  base::Result<std::vector<Piece>> piecesOf(std::span<const std::uint32_t> level) const;
  base::Result<void> makeLevel(std::vector<std::uint32_t>& level);
  base::Result<std::vector<Made>> makeGroups(std::uint32_t level, std::span<const Piece> pieces);
  base::Result<void> makeAgain(std::uint32_t level, std::span<const Piece> pieces, std::vector<Made>& made);
  base::Result<Made> makeGroup(const Piece& piece, WorkUnit unit, const Again* again);
  base::Result<Made> knownOrMade(const Piece& piece, WorkUnit unit, const Again* again);
  base::Result<void> forEachPiece(std::size_t count,
                                  const std::function<base::Result<std::uint64_t>(std::size_t)>& make);
  void addLevelSummary(std::span<const std::uint32_t> level);

  const ingest::SourceLattice& lattice_;
  const HierarchyOptions& options_;
  WorkStore& store_;
  std::function<bool(std::uint64_t)> advance_;
  std::vector<WorkPatch> patches_;
  std::vector<WorkGroup> groups_;
  std::vector<LevelSummary> levels_;
  std::unordered_map<std::uint64_t, Made> known_;  // by level and index
};

}  // namespace lod::patch::builder
