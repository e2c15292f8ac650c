#pragma once
// The levels of the hierarchy, bottom up: patches grouped, groups merged, simplified and split (DESIGN section 4, step
// 3).
//
// Vertices keep their numbers through all levels: a vertex on the border between groups is locked and stays as it is,
// any other belongs to one group alone, which may move it. So groups of a level are independent pieces of work on
// shared arrays, and patches that meet share vertices by number.
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "lod/build/hierarchy_build.h"
#include "lod/build/lattice.h"
#include "lod/patch/hierarchy.h"

namespace lod::build {

/// A patch while it is being worked on; numbers are of the order in which patches are made (leaves first).
struct WorkPatch {
  std::vector<std::uint32_t> vertices;  ///< into the LatticeMesh; emptied when a group has consumed the patch
  std::vector<std::uint16_t> indices;   ///< 3 per triangle, into vertices
  lod::patch::Patch record;             ///< box, bounds, cone, counts, level; producer and consumer by work numbers
  lod::patch::PatchGeometry geometry;   ///< when kept
  base::Bytes bytes;                    ///< when encoded
};

struct WorkGroup {
  lod::patch::Group record;             ///< bounds, errors, level
  std::vector<std::uint32_t> consumed;  ///< work numbers of patches
  std::vector<std::uint32_t> produced;
};

enum class KeepAs { kGeometry, kBytes };

class LevelBuilder {
 public:
  /// `advance(triangles)` is told about finished work from any one thread at a time; false cancels.
  LevelBuilder(LatticeMesh& mesh, const HierarchyOptions& options, KeepAs keep_as,
               std::function<bool(std::uint64_t)> advance);

  /// Voxels, partition and leaf patches.
  void makeLeaves();
  /// All levels up to a single root patch. False when cancelled.
  bool makeLevels();

  std::vector<WorkPatch>& patches() { return patches_; }
  const std::vector<WorkGroup>& groups() const { return groups_; }
  const std::vector<LevelSummary>& levels() const { return levels_; }

 private:
  struct GroupResult {
    WorkGroup group;
    std::vector<WorkPatch> produced;
  };

  std::vector<std::vector<std::uint32_t>> groupPatches(std::span<const std::uint32_t> level);
  void lockSharedVertices(const std::vector<std::vector<std::uint32_t>>& groups);
  bool makeLevel(std::vector<std::uint32_t>& level);
  GroupResult makeGroup(const std::vector<std::uint32_t>& consumed, std::uint32_t level);
  void finishPatch(WorkPatch& patch, std::uint32_t level) const;
  void addLevelSummary(std::span<const std::uint32_t> level);

  LatticeMesh& mesh_;
  const HierarchyOptions& options_;
  KeepAs keep_as_;
  std::function<bool(std::uint64_t)> advance_;
  std::vector<WorkPatch> patches_;
  std::vector<WorkGroup> groups_;
  std::vector<LevelSummary> levels_;
  std::vector<std::uint8_t> locked_;         // per vertex: shared between groups of the level at hand
  std::vector<std::uint32_t> vertex_owner_;  // per vertex, scratch between groups and patches
};

}  // namespace lod::build
