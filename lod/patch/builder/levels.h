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
#include <utility>
#include <vector>

#include "lod/ingest/source_lattice.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/builder/work_store.h"

namespace lod::patch::builder {

struct WorkGroup {
  Group record;                         ///< bounds, errors, level
  std::vector<std::uint32_t> consumed;  ///< work numbers of patches
  std::vector<std::uint32_t> produced;
};

/// All levels up to a single root patch.
struct BuiltLevels {
  std::vector<WorkPatch> patches;  ///< the leaves first, the root last
  std::vector<WorkGroup> groups;
  std::vector<LevelSummary> levels;
};

/// `normals`: what will be stored of them; where light shows them, levels get some that suit their own triangles.
/// `leaves`: bucket by bucket. `known`: what an earlier run left in the store; its groups are used instead of being
/// built again. `advance(triangles)` is called with the triangles of each finished group, by one thread at a time;
/// false cancels. Errors: kCancelled, those of the store.
base::Result<BuiltLevels> buildLevels(const ingest::SourceLattice& lattice, const HierarchyOptions& options,
                                      StoredNormals normals, WorkStore& store, std::vector<WorkPatch> leaves,
                                      std::vector<std::pair<WorkUnit, std::vector<WorkPatch>>> known,
                                      const std::function<bool(std::uint64_t)>& advance);

}  // namespace lod::patch::builder
