#include "lod/build/hierarchy_build.h"

#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <mutex>
#include <optional>

#include "base/file.h"
#include "base/parallel.h"
#include "lod/build/leaves.h"
#include "lod/build/levels.h"
#include "lod/build/stream_mesh.h"
#include "lod/build/work_directory.h"
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

using SourceReader = std::function<base::Result<void>(SourceSpool& spool, HierarchySummary& summary)>;

Error cancelled() {
  return {ErrorCode::kCancelled, "building the patch hierarchy was cancelled"};
}

// Centre of the box, rounded to a power of two of about an eighth of its longest side, so that the number is short and
// the subtraction exact; 0 for models that lie around 0 anyway.
glm::dvec3 originFor(const glm::dvec3& low, const glm::dvec3& high) {
  const glm::dvec3 size = high - low;
  const double longest = std::max({size.x, size.y, size.z});
  const glm::dvec3 reach = glm::max(glm::abs(low), glm::abs(high));
  if (std::max({reach.x, reach.y, reach.z}) <= longest) return glm::dvec3(0.0);
  const double step = longest > 0.0 ? std::exp2(std::floor(std::log2(longest)) - 2.0) : 1.0;
  return glm::round(0.5 * (low + high) / step) * step + 0.0;
}

// One build, stage by stage; each leaves in the work directory what the next one needs.
class Builder {
 public:
  Builder(const HierarchyOptions& options, std::string output_path, const Progress& progress)
      : options_(options), output_path_(std::move(output_path)), progress_(progress) {
    if (options_.threads == 0) options_.threads = base::coreCount();
    memory_ = options_.memory_bytes != 0 ? options_.memory_bytes : machineMemory() / 10 * 6;
  }

  base::Result<HierarchySummary> run(const SourceReader& read_source, const glm::dvec3* origin,
                                     std::uint64_t source_bytes) {
    LUMIGRID_TRY(check(options_));
    if (memory_ < kLeastMemory)
      return Error{ErrorCode::kNoSpace, "the memory given, " + sizeText(memory_) + ", is too small: building needs " +
                                            sizeText(kLeastMemory) + " at least (--memory)"};
    LUMIGRID_TRY(needDescriptors(kDescriptors));
    auto directory = WorkDirectory::open(
        options_.work_directory.empty() ? output_path_ + ".work" : options_.work_directory, resumeKey());
    if (!directory) return directory.error();
    directory_ = std::move(*directory);
    base::removeUnfinished(output_path_);  // nobody else is writing it now
    const Stopwatch watch;
    auto done = stages(read_source, origin, source_bytes);
    if (!done) {
      // What is wrong with the source stays wrong; anything else can go on from the work files.
      const ErrorCode code = done.error().code;
      const bool resumable =
          canResume() && (code == ErrorCode::kCancelled || code == ErrorCode::kNoSpace || code == ErrorCode::kIo);
      if (!resumable) directory_->remove();
      return done.error();
    }
    fillSummary();
    directory_->remove();
    watch.stop(summary_);
    return std::move(summary_);
  }

 private:
  base::Result<void> stages(const SourceReader& read_source, const glm::dvec3* origin, std::uint64_t source_bytes) {
    LUMIGRID_TRY(import(read_source, origin, source_bytes));
    summary_.import_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    LUMIGRID_TRY(sortTriangles());
    std::vector<WorkPatch> leaves;
    LUMIGRID_TRY(openStore());
    LUMIGRID_TRY(makeAllLeaves(leaves));
    LUMIGRID_TRY(makeLevels(std::move(leaves)));
    return write();
  }

  bool report(const std::string& stage, double done) {
    const std::lock_guard lock(progress_mutex_);
    return !progress_ || progress_(stage, done);
  }

  bool canResume() const { return !options_.resume_key.empty(); }

  // Everything that decides the work files, their own format first. Threads and memory do not.
  std::string resumeKey() const {
    if (options_.resume_key.empty()) return {};
    std::string key = "13";
    for (const std::uint32_t v : {options_.voxel_triangles, options_.leaf_triangles, options_.node_triangles,
                                  options_.group_patches, options_.position_bits, options_.regroup ? 1U : 0U}) {
      key += ' ';
      key += std::to_string(v);
    }
    key += ' ';
    return key += options_.resume_key;
  }

  base::Result<void> import(const SourceReader& read_source, const glm::dvec3* origin, std::uint64_t source_bytes) {
    if (directory_->stage() < 1) {
      if (!report("import", 0.0)) return cancelled();
      LUMIGRID_TRY(directory_->needSpace(source_bytes, "the source's vertices and triangles"));
      auto spool = SourceSpool::create(directory_->path());
      if (!spool) return spool.error();
      LUMIGRID_TRY(read_source(*spool, summary_));
      auto info = spool->finish();
      if (!info) return info.error();
      info->warnings = summary_.warnings;
      info->short_faces = summary_.repairs.counts["degenerate_triangles"];
      info_ = std::move(*info);
      const glm::dvec3 size = info_.box_max - info_.box_min;
      const double longest = std::max({size.x, size.y, size.z});
      if (longest > 0.0 && longest < kLeastSize)
        return Error{ErrorCode::kInvalidInput,
                     "the mesh is less than 1e-15 units across, too small for what is computed from it; scale it up"};
      origin_ = origin != nullptr ? *origin : originFor(info_.box_min, info_.box_max);
      // A finished stage is not made again, so the disk must have its files before it says so.
      if (canResume()) LUMIGRID_TRY(spool->sync());
      LUMIGRID_TRY(directory_->finishStage(1, sourceState(*spool)));
    } else {
      LUMIGRID_TRY(readSourceState());
    }
    lattice_ = makeLattice(info_, origin_, options_.position_bits);
    if (options_.on_plan)
      options_.on_plan({info_.triangles, kOutputBytes * info_.triangles, kWorkBytes * info_.triangles,
                        static_cast<double>(info_.triangles) / (kTrianglesPerCoreSecond * options_.threads)});
    return {};
  }

  base::Result<void> sortTriangles() {
    if (directory_->stage() >= 2) {
      auto state = directory_->state(2);
      if (!state) return state.error();
      auto buckets = Buckets::open(directory_->path(), *state);
      if (!buckets) return buckets.error();
      buckets_ = std::move(*buckets);
      return {};
    }
    if (!report("sort", 0.0)) return cancelled();
    const std::uint64_t record = 3 * (8U + (info_.has_colors ? 4U : 0U) + (info_.has_normals ? 4U : 0U));
    LUMIGRID_TRY(directory_->needSpace(info_.triangles * record, "the triangles sorted by voxels"));
    auto spool = SourceSpool::open(directory_->path());
    if (!spool) return spool.error();
    if (spool_bytes_ != std::pair{spool->vertexBytes(), spool->triangleBytes()}) return directory_->broken();
    BucketOptions options;
    options.memory_bytes = (memory_ - kLeastMemory / 2) / 2;
    options.threads = options_.threads;
    options.progress = [this](double done) { return report("sort", done); };
    auto buckets = Buckets::sort(*spool, info_, lattice_, directory_->path(), options);
    if (!buckets) return buckets.error();
    buckets_ = std::move(*buckets);
    if (canResume()) LUMIGRID_TRY(buckets_.sync());
    LUMIGRID_TRY(directory_->finishStage(2, buckets_.state()));
    spool->remove();
    releaseFreedMemory();
    return {};
  }

  base::Result<void> openStore() {
    const bool resume = directory_->has("patches");
    auto store = WorkStore::open(directory_->path() + "/patches", resume,
                                 [this](const WorkUnit& unit, std::vector<WorkPatch> patches) {
                                   known_.emplace_back(unit, std::move(patches));
                                 });
    if (!store) return store.error();
    store_ = std::move(*store);
    // What is still to come: about 7 bytes for each of twice the triangles, and the same again as patch.lgp.
    LUMIGRID_TRY(directory_->needSpace(
        std::max<std::uint64_t>(14 * buckets_.totals().triangles, store_->bytes()) - store_->bytes(), "the patches"));
    return needOutputSpace(output_path_, kOutputBytes * buckets_.totals().triangles);
  }

  base::Result<void> makeAllLeaves(std::vector<WorkPatch>& leaves) {
    std::vector<std::vector<WorkPatch>> made(buckets_.count());
    std::vector<std::uint8_t> finished(buckets_.count(), 0);
    auto note = [this](const WorkUnit& unit) {
      duplicates_ += unit.group.first_patch;
      inner_vertices_ += unit.group.block_offset;
    };
    std::uint64_t done = 0;
    std::uint64_t largest = 1;
    for (auto& [unit, patches] : known_) {
      if (unit.level != 0 || unit.index >= made.size()) continue;
      note(unit);
      made[unit.index] = std::move(patches);
      finished[unit.index] = 1;
      done += buckets_.triangles(unit.index);
    }
    for (std::size_t b = 0; b < made.size(); ++b) {
      largest = std::max(largest, buckets_.triangles(b));
      if (finished[b] == 0 && directory_->stage() >= 3) return directory_->broken();
    }

    // As many buckets at a time as memory holds.
    const std::uint64_t at_once =
        std::max<std::uint64_t>(1, (memory_ - kLeastMemory / 2) / (kBytesPerTriangle * largest));
    std::mutex mutex;
    std::atomic<bool> stopped = false;
    base::Result<void> status;
    base::parallelFor(
        made.size(), static_cast<unsigned>(std::min<std::uint64_t>(options_.threads, at_once)), [&](std::size_t b) {
          if (finished[b] != 0 || stopped) return;
          auto bucket = makeLeaves(buckets_, b, lattice_, {options_.voxel_triangles, options_.leaf_triangles});
          base::Result<std::vector<WorkPatch>> stored = std::vector<WorkPatch>();
          WorkUnit unit{0, static_cast<std::uint32_t>(b), {}};
          if (bucket) {
            // A unit of leaves has no group; its counts travel in the record's unused numbers.
            unit.group.first_patch = static_cast<std::uint32_t>(bucket->duplicates);
            unit.group.block_offset = bucket->vertices;
            stored = store_->add(unit, std::move(bucket->patches));
          }
          const std::lock_guard lock(mutex);
          if (!bucket || !stored) {
            status = bucket ? stored.error() : bucket.error();
            stopped = true;
            return;
          }
          note(unit);
          made[b] = std::move(*stored);
          done += buckets_.triangles(b);
          if (!report("leaves", static_cast<double>(done) / static_cast<double>(buckets_.totals().triangles)))
            status = cancelled(), stopped = true;
        });
    LUMIGRID_TRY(status);
    // From here on the store alone holds the mesh.
    if (directory_->stage() < 3) {
      LUMIGRID_TRY(store_->sync());
      LUMIGRID_TRY(directory_->finishStage(3, {}));
      buckets_.release();
    }
    for (auto& patches : made)
      for (WorkPatch& patch : patches) leaves.push_back(std::move(patch));
    return {};
  }

  base::Result<void> makeLevels(std::vector<WorkPatch> leaves) {
    for (const WorkPatch& leaf : leaves) summary_.triangles += leaf.record.triangles;
    // Groups keep two fifths, pairs of the binary tree a half: that often the leaves' in all.
    const double all = static_cast<double>(summary_.triangles) * (options_.regroup ? 5.0 / 3.0 : 2.0);
    std::uint64_t finished = 0;
    levels_.emplace(lattice_, options_, *store_, [&, this](std::uint64_t more) {
      finished += more;
      return report("simplify", std::min(1.0, static_cast<double>(finished) / all));
    });
    for (auto& [unit, patches] : known_)
      if (unit.level != 0) levels_->know(unit, std::move(patches));
    known_.clear();
    return levels_->makeLevels(std::move(leaves));
  }

  base::Result<void> write() {
    if (!report("write", 0.0)) return cancelled();
    Hierarchy hierarchy;
    hierarchy.lattice = lattice_.lattice;
    hierarchy.has_colors = buckets_.hasColors();
    hierarchy.source_triangles = summary_.triangles;
    const std::vector<WorkPatch>& patches = levels_->patches();
    const Numbering numbering(patches, levels_->groups());
    numbering.fill(hierarchy);
    const std::vector<std::uint32_t> order = numbering.patchOrder();
    std::vector<std::uint32_t> first;
    for (const lod::patch::Group& group : hierarchy.groups) first.push_back(group.first_patch);
    first.push_back(static_cast<std::uint32_t>(order.size()));
    return lod::patch::writePatchFile(output_path_, std::move(hierarchy),
                                      [&](std::uint32_t group) -> base::Result<std::vector<base::Bytes>> {
                                        std::vector<base::Bytes> block;
                                        for (std::uint32_t p = first[group]; p < first[group + 1]; ++p) {
                                          auto bytes = store_->encoded(patches[order[p]]);
                                          if (!bytes) return bytes.error();
                                          block.push_back(std::move(*bytes));
                                        }
                                        return block;
                                      });
  }

  void fillSummary() {
    summary_.levels = levels_->levels();
    summary_.origin = origin_;
    summary_.box_min = info_.box_min;
    summary_.box_max = info_.box_max;
    summary_.facing = buckets_.totals().facing;
    summary_.has_colors = buckets_.hasColors();
    summary_.warnings = info_.warnings;
    summary_.repairs = {};
    summary_.repairs.add("degenerate_triangles", info_.short_faces + buckets_.totals().degenerate);
    summary_.repairs.add("lattice_collapsed_triangles", buckets_.totals().collapsed);
    summary_.repairs.add("duplicate_triangles", duplicates_);
    summary_.repairs.add("flipped_triangles", buckets_.winding().flipped());
    summary_.repairs.add("non_orientable_parts", buckets_.winding().nonOrientable());
    summary_.repairs.add("unreferenced_vertices", info_.vertices - info_.referenced);
    const std::uint64_t distinct = inner_vertices_ + buckets_.border().codes.size();
    summary_.repairs.add("welded_vertices", info_.referenced - std::min(info_.referenced, distinct));
    std::error_code ignored;
    summary_.bytes = std::filesystem::file_size(output_path_, ignored);
  }

  base::Bytes sourceState(const SourceSpool& spool) {
    spool_bytes_ = {spool.vertexBytes(), spool.triangleBytes()};
    base::ByteWriter out;
    out.u64(spool_bytes_.first);
    out.u64(spool_bytes_.second);
    out.write(origin_);
    out.u64(info_.vertices);
    out.u64(info_.triangles);
    out.u64(info_.referenced);
    out.u8(info_.has_normals ? 1 : 0);
    out.u8(info_.has_colors ? 1 : 0);
    out.write(info_.box_min);
    out.write(info_.box_max);
    out.write(info_.mean_edge);
    out.u64(info_.short_faces);
    out.u32(static_cast<std::uint32_t>(info_.warnings.size()));
    for (const std::string& warning : info_.warnings) out.string16(warning);
    return out.take();
  }

  base::Result<void> readSourceState() {
    auto state = directory_->state(1);
    if (!state) return state.error();
    base::ByteReader in(*state);
    spool_bytes_.first = in.u64();
    spool_bytes_.second = in.u64();
    origin_ = in.read<glm::dvec3>();
    info_.vertices = in.u64();
    info_.triangles = in.u64();
    info_.referenced = in.u64();
    info_.has_normals = in.u8() != 0;
    info_.has_colors = in.u8() != 0;
    info_.box_min = in.read<glm::dvec3>();
    info_.box_max = in.read<glm::dvec3>();
    info_.mean_edge = in.read<double>();
    info_.short_faces = in.u64();
    for (std::uint32_t left = in.u32(); left > 0 && in.ok(); --left) info_.warnings.push_back(in.string16());
    if (!in.atEnd()) return directory_->broken();
    return {};
  }

  static constexpr std::uint64_t kDescriptors = 32;
  // Squares of parts of it must stay above float32's smallest.
  static constexpr double kLeastSize = 1e-15;
  // Per triangle of the source, measured on scans with colours.
  static constexpr std::uint64_t kOutputBytes = 12;
  static constexpr std::uint64_t kWorkBytes = 70;
  static constexpr double kTrianglesPerCoreSecond = 0.3e6;
  // What a bucket takes while leaves are made of it, bytes per triangle, measured.
  static constexpr std::uint64_t kBytesPerTriangle = 420;

  HierarchyOptions options_;
  std::string output_path_;
  const Progress& progress_;
  std::uint64_t memory_ = 0;
  std::mutex progress_mutex_;
  std::optional<WorkDirectory> directory_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  SourceInfo info_;
  std::pair<std::uint64_t, std::uint64_t> spool_bytes_;  // of its vertices and triangles
  glm::dvec3 origin_{0.0};
  SourceLattice lattice_;
  Buckets buckets_;
  std::optional<WorkStore> store_;
  std::vector<std::pair<WorkUnit, std::vector<WorkPatch>>> known_;
  std::optional<LevelBuilder> levels_;
  std::uint64_t duplicates_ = 0;
  std::uint64_t inner_vertices_ = 0;
  HierarchySummary summary_;
};

base::Result<void> checkMesh(const Mesh& mesh) {
  if (mesh.indices.size() < 3) return Error{ErrorCode::kInvalidInput, "the mesh has no triangles"};
  for (std::size_t i = 0; i < mesh.indices.size(); ++i)
    if (mesh.indices[i] >= mesh.positions.size())
      return Error{ErrorCode::kInvalidInput, "triangle " + std::to_string(i / 3) + ": vertex " +
                                                 std::to_string(mesh.indices[i]) + " is out of range (" +
                                                 std::to_string(mesh.positions.size()) + " vertices)"};
  return {};
}

base::Result<void> spoolMesh(const Mesh& mesh, SourceSpool& spool) {
  constexpr std::size_t kBlock = std::size_t{1} << 16;
  spool.beginFile("mesh");
  std::vector<glm::dvec3> positions;
  for (std::size_t begin = 0; begin < mesh.positions.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, mesh.positions.size() - begin);
    positions.assign(mesh.positions.begin() + static_cast<std::ptrdiff_t>(begin),
                     mesh.positions.begin() + static_cast<std::ptrdiff_t>(begin + count));
    for (glm::dvec3& p : positions) p += mesh.origin;
    VertexBlock block;
    block.positions = positions;
    if (!mesh.normals.empty()) block.normals = std::span(mesh.normals).subspan(begin, count);
    if (!mesh.colors.empty()) block.colors = std::span(mesh.colors).subspan(begin, count);
    LUMIGRID_TRY(spool.vertices(block));
  }
  std::vector<std::uint64_t> corners;
  for (std::size_t begin = 0; begin < mesh.indices.size(); begin += 3 * kBlock) {
    const std::size_t count = std::min(3 * kBlock, mesh.indices.size() - begin);
    corners.assign(mesh.indices.begin() + static_cast<std::ptrdiff_t>(begin),
                   mesh.indices.begin() + static_cast<std::ptrdiff_t>(begin + count));
    LUMIGRID_TRY(spool.triangles({corners, {}, {}}));
  }
  return {};
}

}  // namespace

base::Result<HierarchySummary> buildHierarchyFromFiles(const std::vector<std::string>& paths,
                                                       const HierarchyOptions& options, const std::string& output_path,
                                                       const Progress& progress) {
  if (paths.empty()) return Error{ErrorCode::kInvalidInput, "no mesh file is named"};
  std::uint64_t bytes = 0;
  for (const std::string& path : paths) {
    std::error_code ignored;
    const auto size = std::filesystem::file_size(path, ignored);
    if (!ignored) bytes += size;
  }
  const SourceReader read = [&](SourceSpool& spool, HierarchySummary& summary) -> base::Result<void> {
    std::vector<bool> colored;
    for (std::size_t i = 0; i < paths.size(); ++i) {
      StreamOptions stream;
      stream.progress = [&](double done) {
        return !progress || progress("import", (static_cast<double>(i) + done) / static_cast<double>(paths.size()));
      };
      spool.beginFile(paths[i]);
      auto file = streamMesh(paths[i], spool, stream);
      if (!file) return file.error();
      for (const std::string& warning : file->warnings) summary.warnings.push_back(paths[i] + ": " + warning);
      summary.repairs.add("degenerate_triangles", file->short_faces);
      colored.push_back(file->has_colors);
    }
    for (std::size_t i = 0; i < paths.size(); ++i)
      if (!colored[i] && std::find(colored.begin(), colored.end(), true) != colored.end())
        summary.warnings.push_back(paths[i] + ": has no colours while other files have; it becomes white");
    return {};
  };
  auto summary = Builder(options, output_path, progress).run(read, nullptr, bytes);
  // Work files that do not hold together are gone by now.
  if (!summary && isDamage(summary.error()))
    summary = Builder(options, output_path, progress).run(read, nullptr, bytes);
  if (summary) return summary;
  const std::string& message = summary.error().message;
  const bool of_mesh = message.rfind("the mesh", 0) == 0 || message.rfind("no triangle", 0) == 0;
  return of_mesh ? base::within(paths.front(), summary.error()) : summary.error();
}

base::Result<HierarchySummary> buildHierarchy(const Mesh& mesh, const HierarchyOptions& options,
                                              const std::string& output_path, const Progress& progress) {
  LUMIGRID_TRY(checkMesh(mesh));
  const SourceReader read = [&](SourceSpool& spool, HierarchySummary&) { return spoolMesh(mesh, spool); };
  return Builder(options, output_path, progress)
      .run(read, &mesh.origin, 16 * (mesh.positions.size() + mesh.triangleCount()));
}

base::Result<BuiltHierarchy> buildHierarchyInMemory(const Mesh& mesh, const HierarchyOptions& options,
                                                    const Progress& progress) {
  auto directory = TemporaryDirectory::make();
  if (!directory) return directory.error();
  const std::string path = directory->path() + "/patch.lgp";
  auto summary = buildHierarchy(mesh, options, path, progress);
  if (!summary) return summary.error();
  auto file = lod::patch::PatchFile::open(path);
  if (!file) return file.error();
  BuiltHierarchy out;
  out.summary = std::move(*summary);
  out.hierarchy = file->hierarchy();
  for (std::uint32_t p = 0; p < out.hierarchy.patches.size(); ++p) {
    auto geometry = file->geometry(p);
    if (!geometry) return geometry.error();
    out.geometry.push_back(std::move(*geometry));
  }
  return out;
}

}  // namespace lod::build
