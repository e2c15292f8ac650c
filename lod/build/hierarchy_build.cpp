#include "lod/build/hierarchy_build.h"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <limits>

#include "base/file.h"
#include "lod/build/lattice.h"
#include "lod/build/levels.h"
#include "lod/patch/codec.h"
#include "lod/patch/format.h"

namespace lod::build {
namespace {

using base::Error;
using base::ErrorCode;
using lod::patch::Hierarchy;


double cpuSeconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

class Stopwatch {
 public:
  void stop(HierarchySummary& summary) const {
    summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    summary.cpu_seconds = cpuSeconds() - cpu_start_;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  double cpu_start_ = cpuSeconds();
};

base::Result<void> check(const HierarchyOptions& options) {
  // Three vertices a triangle must fit 16-bit indices, and a voxel must fit a patch.
  constexpr std::uint32_t kMost = lod::patch::kMaxPatchVertices / 3;
  auto inRange = [](std::uint32_t value, std::uint32_t low, std::uint32_t high) {
    return low <= value && value <= high;
  };
  if (!inRange(options.leaf_triangles, 16, kMost) || !inRange(options.node_triangles, 16, kMost))
    return Error{ErrorCode::kInvalidInput, "triangles per patch must be 16 to " + std::to_string(kMost)};
  if (!inRange(options.voxel_triangles, 1, options.leaf_triangles))
    return Error{ErrorCode::kInvalidInput, "triangles per voxel must be 1 to the triangles per leaf patch"};
  if (!inRange(options.group_patches, 2, 64))
    return Error{ErrorCode::kInvalidInput, "patches per group must be 2 to 64"};
  if (options.position_bits != 0 && !inRange(options.position_bits, 10, kMaxLatticeBits))
    return Error{ErrorCode::kInvalidInput, "position bits must be 10 to 21, or 0 to choose"};
  return {};
}

// The hierarchy's numbers: groups from the top level down after the virtual group 0, patches by the group that consumes
// them.
class Numbering {
 public:
  Numbering(const std::vector<WorkPatch>& patches, const std::vector<WorkGroup>& groups)
      : patches_(patches), groups_(groups) {
    // Work groups were made level by level, bottom up.
    for (std::uint32_t g = 0; g < groups.size(); ++g) group_order_.push_back(g);
    std::stable_sort(group_order_.begin(), group_order_.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return groups[a].record.level > groups[b].record.level; });
    group_number_.resize(groups.size());
    for (std::uint32_t i = 0; i < group_order_.size(); ++i) group_number_[group_order_[i]] = i + 1;
    patch_order_.push_back(static_cast<std::uint32_t>(patches.size() - 1));
    for (const std::uint32_t g : group_order_)
      patch_order_.insert(patch_order_.end(), groups[g].consumed.begin(), groups[g].consumed.end());
  }

  void fill(Hierarchy& hierarchy) const {
    addRoot(hierarchy);
    for (const std::uint32_t g : group_order_) addGroup(hierarchy, groups_[g]);
    for (const std::uint32_t p : patch_order_) addPatch(hierarchy, patches_[p]);
  }
  const std::vector<std::uint32_t>& patchOrder() const { return patch_order_; }

 private:
  // Expands always, consumes the last patch made; it contains all, as the top group does.
  void addRoot(Hierarchy& hierarchy) const {
    lod::patch::Group root;
    const WorkPatch& top = patches_.back();
    root.bounds = groups_.empty() ? top.record.bounds : groups_.back().record.bounds;
    root.error = std::numeric_limits<float>::infinity();
    root.attribute_error = groups_.empty() ? 0.0F : groups_.back().record.attribute_error;
    root.level = top.record.level + 1;
    root.patch_count = 1;
    hierarchy.groups.push_back(root);
  }

  void addGroup(Hierarchy& hierarchy, const WorkGroup& work) const {
    lod::patch::Group group = work.record;
    group.first_patch = hierarchy.groups.back().first_patch + hierarchy.groups.back().patch_count;
    group.patch_count = static_cast<std::uint32_t>(work.consumed.size());
    std::vector<std::uint32_t> parents;
    for (const std::uint32_t p : work.produced) parents.push_back(consumerOf(patches_[p]));
    std::sort(parents.begin(), parents.end());
    parents.erase(std::unique(parents.begin(), parents.end()), parents.end());
    group.first_parent = static_cast<std::uint32_t>(hierarchy.parents.size());
    group.parent_count = static_cast<std::uint32_t>(parents.size());
    hierarchy.parents.insert(hierarchy.parents.end(), parents.begin(), parents.end());
    hierarchy.groups.push_back(group);
  }

  void addPatch(Hierarchy& hierarchy, const WorkPatch& work) const {
    lod::patch::Patch patch = work.record;
    patch.consumer = consumerOf(work);
    if (patch.producer != lod::patch::kNoGroup) patch.producer = group_number_[patch.producer];
    hierarchy.patches.push_back(patch);
  }
  std::uint32_t consumerOf(const WorkPatch& work) const {
    return &work == &patches_.back() ? 0 : group_number_[work.record.consumer];
  }

  const std::vector<WorkPatch>& patches_;
  const std::vector<WorkGroup>& groups_;
  std::vector<std::uint32_t> group_order_;
  std::vector<std::uint32_t> group_number_;
  std::vector<std::uint32_t> patch_order_;
};

struct Built {
  Hierarchy hierarchy;
  std::vector<WorkPatch> patches;
  std::vector<std::uint32_t> patch_order;  // hierarchy's patch number -> work number
  HierarchySummary summary;
};

base::Result<Built> build(const Mesh& mesh, const HierarchyOptions& options, KeepAs keep_as, const Progress& progress) {
  const Error cancelled{ErrorCode::kCancelled, "building the patch hierarchy was cancelled"};
  auto report = [&](const std::string& stage, double done) { return !progress || progress(stage, done); };
  LUMIGRID_TRY(check(options));
  if (!report("quantise", 0.0)) return cancelled;
  base::Result<LatticeMesh> lattice = latticeMesh(mesh, options.position_bits);
  if (!lattice) return lattice.error();
  const std::uint64_t triangles = lattice->indices.size() / 3;

  // Each level has half the triangles of the one below: twice the leaves' in all.
  std::uint64_t finished = 0;
  LevelBuilder levels(*lattice, options, keep_as, [&](std::uint64_t more) {
    finished += more;
    return report("simplify",
                  0.1 + 0.9 * std::min(1.0, static_cast<double>(finished) / (2.0 * static_cast<double>(triangles))));
  });
  if (!report("partition", 0.05)) return cancelled;
  levels.makeLeaves();
  if (!levels.makeLevels()) return cancelled;

  Built built;
  built.patches = std::move(levels.patches());
  built.hierarchy.lattice = lattice->lattice;
  built.hierarchy.has_colors = !mesh.colors.empty();
  built.hierarchy.source_triangles = triangles;
  const Numbering numbering(built.patches, levels.groups());
  numbering.fill(built.hierarchy);
  built.patch_order = numbering.patchOrder();
  built.summary.levels = levels.levels();
  built.summary.repairs = lattice->repairs;
  return built;
}

}  // namespace

base::Result<HierarchySummary> buildHierarchy(const Mesh& mesh, const HierarchyOptions& options,
                                              const std::string& output_path, const Progress& progress) {
  const Stopwatch watch;
  base::Result<Built> built = build(mesh, options, KeepAs::kBytes, progress);
  if (!built) return built.error();

  const Hierarchy& hierarchy = built->hierarchy;
  auto blockOf = [&](std::uint32_t group) -> base::Result<std::vector<base::Bytes>> {
    std::vector<base::Bytes> block;
    const lod::patch::Group& g = hierarchy.groups[group];
    for (std::uint32_t p = g.first_patch; p < g.first_patch + g.patch_count; ++p)
      block.push_back(std::move(built->patches[built->patch_order[p]].bytes));
    return block;
  };
  std::uint64_t bytes = 0;
  for (const WorkPatch& patch : built->patches) bytes += patch.bytes.size();
  LUMIGRID_TRY(lod::patch::writePatchFile(output_path, hierarchy, blockOf));
  built->summary.bytes = bytes;
  if (const auto file = base::MappedFile::open(output_path)) built->summary.bytes = file->bytes().size();
  watch.stop(built->summary);
  return std::move(built->summary);
}

base::Result<BuiltHierarchy> buildHierarchyInMemory(const Mesh& mesh, const HierarchyOptions& options,
                                                    const Progress& progress) {
  const Stopwatch watch;
  base::Result<Built> built = build(mesh, options, KeepAs::kGeometry, progress);
  if (!built) return built.error();
  BuiltHierarchy out;
  for (const std::uint32_t p : built->patch_order) out.geometry.push_back(std::move(built->patches[p].geometry));
  out.hierarchy = std::move(built->hierarchy);
  out.summary = std::move(built->summary);
  watch.stop(out.summary);
  return out;
}

}  // namespace lod::build
