#pragma once
// Builds the levels of the hierarchy, bottom up: patches are grouped, and each group is merged, simplified and split
// into new patches (Okamoto 2011, section 4.1, step 3). Geometry lies in the store. Memory holds a record per patch
// and, for the level that is being built, the border vertices.
//
// A vertex is known by its Morton code. A vertex on the border between groups is locked and stays as it is; any other
// belongs to one group alone, which may move it. So the groups of a level are built independently of each other, and
// patches that meet share vertices by code.
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
  Group record;                         ///< bounds, errors, level
  std::vector<std::uint32_t> consumed;  ///< work numbers of patches
  std::vector<std::uint32_t> produced;
};

class LevelBuilder {
 public:
  /// `advance(triangles)` is called with the triangles of each finished group, by one thread at a time; false cancels.
  LevelBuilder(const ingest::SourceLattice& lattice, const HierarchyOptions& options, WorkStore& store,
               std::function<bool(std::uint64_t)> advance);

  /// A group that an earlier run left in the store; it is used instead of being built again.
  void addKnownGroup(const WorkUnit& unit, std::vector<WorkPatch> patches);
  /// All levels up to a single root patch. `leaves`: bucket by bucket. Errors: kCancelled, those of the store.
  base::Result<void> buildLevels(std::vector<WorkPatch> leaves);

  std::vector<WorkPatch>& patches() { return patches_; }
  const std::vector<WorkGroup>& groups() const { return groups_; }
  const std::vector<LevelSummary>& levels() const { return levels_; }

 private:
  struct GroupInput {
    std::vector<std::uint32_t> consumed;  // work numbers of patches
    std::vector<std::uint64_t> locked;    // codes of the vertices shared with other groups
  };
  struct BuiltGroup {
    Group record;
    ErrorHistogram errors;
    std::vector<WorkPatch> produced;
    std::optional<std::vector<Outlier>> outliers;  // unknown where an earlier run built the group
  };
  /// A group's error stands out from its level: it is built once more, within a limit.
  struct RebuildRequest {
    float max_error = 0.0F;                        // lattice steps
    std::optional<std::vector<Outlier>> outliers;  // outliers of the first build, where known
  };
  struct SharedVertex {
    std::uint64_t code = 0;
    std::uint32_t patch = 0;  // place in the level
  };

  base::Result<std::vector<SharedVertex>> sharedVertices(std::span<const std::uint32_t> level) const;
  std::vector<std::uint32_t> groupOfPatches(std::span<const std::uint32_t> level, std::span<const SharedVertex> shared,
                                            std::uint32_t& groups) const;
  base::Result<std::vector<GroupInput>> groupInputs(std::span<const std::uint32_t> level) const;
  base::Result<void> buildLevel(std::vector<std::uint32_t>& level);
  base::Result<std::vector<BuiltGroup>> buildGroups(std::uint32_t level, std::span<const GroupInput> inputs);
  base::Result<void> rebuildOutlyingGroups(std::uint32_t level, std::span<const GroupInput> inputs,
                                           std::vector<BuiltGroup>& built);
  base::Result<BuiltGroup> findOrBuildGroup(const GroupInput& input, WorkUnit unit, const RebuildRequest* rebuild);
  base::Result<BuiltGroup> buildGroup(const GroupInput& input, WorkUnit unit, const RebuildRequest* rebuild);
  base::Result<std::vector<PatchGeometry>> readGeometry(const GroupInput& input, SurfaceError& carried) const;
  std::vector<base::Sphere> addErrorsBelow(const GroupInput& input, Group& record) const;
  base::Result<void> forEachGroup(std::size_t count,
                                  const std::function<base::Result<std::uint64_t>(std::size_t)>& build);
  void addLevelSummary(std::span<const std::uint32_t> level);

  const ingest::SourceLattice& lattice_;
  const HierarchyOptions& options_;
  WorkStore& store_;
  std::function<bool(std::uint64_t)> advance_;
  std::vector<WorkPatch> patches_;
  std::vector<WorkGroup> groups_;
  std::vector<LevelSummary> levels_;
  std::unordered_map<std::uint64_t, BuiltGroup> known_;  // by level and index
};

}  // namespace lod::patch::builder
