#include "lod/qsplat/builder/build.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <optional>

#include "base/file.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "base/stopwatch.h"
#include "lod/qsplat/builder/file_build.h"
#include "lod/qsplat/builder/mesh_leaves.h"
#include "lod/qsplat/builder/point_leaves.h"

namespace lod::qsplat::builder {
namespace {

using base::Error;
using base::ErrorCode;

Error cancelled() {
  return {ErrorCode::kCancelled, "building the splat tree was cancelled"};
}

// One build, stage by stage; each leaves in the work directory what the next one needs.
class Builder {
 public:
  Builder(const BuildOptions& options, std::string output_path, const ingest::Progress& progress)
      : options_(options), output_path_(std::move(output_path)), progress_(progress) {
    options_.limits = options_.limits.resolved();
  }

  base::Result<BuildSummary> run(const ingest::SourceInput& input) {
    LUMIGRID_TRY(ingest::needMemory(options_.limits.memory_bytes));
    LUMIGRID_TRY(ingest::needDescriptors(kDescriptors));
    base::keepFreedMemory();
    const ingest::ResumeKey key =
        ingest::withPrefix("qsplat 4 " + std::to_string(options_.dice) + " ", options_.resume_key);
    LUMIGRID_TRY(
        ingest::runStages(directory_, options_.work_directory, key, output_path_, [&] { return stages(input); }));
    return std::move(summary_);
  }

 private:
  base::Result<void> stages(const ingest::SourceInput& input) {
    LUMIGRID_TRY(import(input));
    summary_.import_seconds = watch_.seconds();
    LUMIGRID_TRY(isMesh() ? sortTriangles() : sortPoints());
    LUMIGRID_TRY(isMesh() ? measureBorder() : orientPoints());
    LUMIGRID_TRY(makeSubtrees());
    LUMIGRID_TRY(write());
    if (options_.on_written) options_.on_written();
    fillSummary();
    return {};
  }

  bool report(const std::string& stage, double done) {
    const std::lock_guard lock(progress_mutex_);
    return !progress_ || progress_(stage, done);
  }
  bool isMesh() const { return source_.info.triangles > 0; }
  std::uint64_t workMemory() const { return options_.limits.memory_bytes - ingest::kMinMemory / 2; }

  base::Result<void> import(const ingest::SourceInput& input) {
    if (!directory_->isFinished(ingest::Stage::kSpooled) && !report("import", 0.0)) return cancelled();
    LUMIGRID_ASSIGN_OR_RETURN(auto source, ingest::importSource(*directory_, input, options_.limits.threads));
    source_ = std::move(source);
    const std::uint64_t leaves = source_.info.referenced;
    if (options_.on_plan)
      options_.on_plan({source_.info.triangles, leaves, kOutputBytes * leaves,
                        kBucketBytes * source_.info.triangles + kWorkBytes * leaves,
                        static_cast<double>(leaves) / (kLeavesPerCoreSecond * options_.limits.threads)});
    return {};
  }

  base::Result<void> sortTriangles() {
    lattice_ = ingest::makeLattice(source_.info, source_.origin, 0);
    if (!directory_->isFinished(ingest::Stage::kSorted) && !report("sort", 0.0)) return cancelled();
    auto buckets = ingest::sortSource(
        *directory_, source_, lattice_,
        {{options_.limits.threads, workMemory() / 2}, [this](double done) { return report("sort", done); }});
    if (!buckets) return buckets.error();
    buckets_ = std::move(*buckets);
    return {};
  }

  // Stage 3.
  base::Result<void> measureBorder() {
    auto& leaves = mesh_leaves_.emplace(buckets_, lattice_, options_.dice);
    if (directory_->isFinished(ingest::Stage::kSplatLeaves)) {
      LUMIGRID_ASSIGN_OR_RETURN(auto state, directory_->state(ingest::Stage::kSplatLeaves));
      base::ByteReader in(state);
      return leaves.readBorder(in) && in.atEnd() ? base::Result<void>() : directory_->damaged();
    }
    LUMIGRID_TRY(leaves.measureBorder(tilesAtOnce(leaves), [this](double done) { return report("borders", done); }));
    base::ByteWriter out;
    leaves.writeBorder(out);
    return directory_->finishStage(ingest::Stage::kSplatLeaves, out.take(), {});
  }

  // Stage 2 of points.
  base::Result<void> sortPoints() {
    lattice_ = ingest::makeLattice(source_.info, source_.origin, ingest::kMaxLatticeBits);
    if (directory_->isFinished(ingest::Stage::kSorted)) {
      LUMIGRID_ASSIGN_OR_RETURN(auto state, directory_->state(ingest::Stage::kSorted));
      LUMIGRID_ASSIGN_OR_RETURN(auto tiles, PointTiles::open(directory_->path(), lattice_, state));
      points_ = std::move(tiles);
      return {};
    }
    LUMIGRID_TRY(directory_->needSpace(kPointBytes * source_.info.vertices, "the points sorted by tiles"));
    LUMIGRID_ASSIGN_OR_RETURN(auto spool, ingest::openSource(*directory_, source_));
    auto tiles = PointTiles::sort(spool, source_.info, lattice_, directory_->path(),
                                  [this](double done) { return report("sort", done); });
    if (!tiles) return tiles.error();
    points_ = std::move(*tiles);
    const auto sorted = std::make_shared<ingest::SourceSpool>(std::move(spool));
    LUMIGRID_TRY(
        directory_->finishStage(ingest::Stage::kSorted, points_.state(), {"points"}, [sorted] { sorted->remove(); }));
    base::releaseFreedMemory(options_.limits.memory_bytes);
    return {};
  }

  // Stage 3 of points.
  base::Result<void> orientPoints() {
    auto& leaves = point_leaves_.emplace(points_, lattice_, source_.info.has_normals);
    for (std::size_t t = 0; t < leaves.tiles(); ++t)
      if (leaves.memoryOf(t) > workMemory())
        return Error{ErrorCode::kNoSpace, "the memory given is too small: " + std::to_string(points_.points(t)) +
                                              " points lie in nearly one place (--memory)"};
    const std::string path = directory_->path() + "/leaves";
    if (directory_->isFinished(ingest::Stage::kSplatLeaves)) {
      LUMIGRID_ASSIGN_OR_RETURN(auto state, directory_->state(ingest::Stage::kSplatLeaves));
      base::ByteReader in(state);
      return leaves.reopen(path, in);
    }
    LUMIGRID_TRY(directory_->needSpace(kFittedBytes * source_.info.vertices, "the fitted points"));
    LUMIGRID_TRY(leaves.fitAll(path, tilesAtOnce(leaves), [this](double done) { return report("normals", done); }));
    base::ByteWriter out;
    leaves.writeSigns(out);
    return directory_->finishStage(ingest::Stage::kSplatLeaves, out.take(), {"leaves"}, [this] { points_.release(); });
  }

  const LeafSource& leafSource() const {
    return isMesh() ? static_cast<const LeafSource&>(*mesh_leaves_) : *point_leaves_;
  }

  // As many tiles at a time as memory holds.
  unsigned tilesAtOnce(const LeafSource& leaves) const {
    std::uint64_t largest = 1;
    for (std::size_t t = 0; t < leaves.tiles(); ++t) largest = std::max(largest, leaves.memoryOf(t));
    return static_cast<unsigned>(std::clamp<std::uint64_t>(workMemory() / largest, 1, options_.limits.threads));
  }

  std::uint64_t mostLeaves() const { return source_.info.referenced + (isMesh() ? mesh_leaves_->mostAdded() : 0); }

  // Stage 4.
  base::Result<void> makeSubtrees() {
    const LeafSource& leaves = leafSource();
    const std::string path = directory_->path() + "/nodes";
    LUMIGRID_ASSIGN_OR_RETURN(auto store, SubtreeStore::open(path, directory_->has("nodes"), leaves.tiles()));
    subtrees_ = std::move(store);
    LUMIGRID_TRY(directory_->needSpace(std::max(kWorkBytes * mostLeaves(), subtrees_->bytes()) - subtrees_->bytes(),
                                       "the splat tree"));
    LUMIGRID_TRY(ingest::needOutputSpace(output_path_, kOutputBytes * mostLeaves()));
    std::size_t done = 0;
    for (std::size_t t = 0; t < leaves.tiles(); ++t) {
      done += subtrees_->has(t) ? 1 : 0;
      if (!subtrees_->has(t) && directory_->isFinished(ingest::Stage::kSplatSubtrees)) return directory_->damaged();
    }
    std::mutex mutex;
    base::Result<void> status;
    std::atomic<bool> stopped = false;
    base::parallelFor(leaves.tiles(), tilesAtOnce(leaves), [&](std::size_t t) {
      if (stopped || subtrees_->has(t)) return;
      auto made = makeTile(leaves, t);
      const std::lock_guard lock(mutex);
      ++done;
      if (made && !report("tree", static_cast<double>(done) / static_cast<double>(leaves.tiles()))) made = cancelled();
      if (!made) status = made, stopped = true;
    });
    LUMIGRID_TRY(status);
    // From here on the store alone holds the leaves.
    if (!directory_->isFinished(ingest::Stage::kSplatSubtrees)) {
      LUMIGRID_TRY(directory_->finishStage(ingest::Stage::kSplatSubtrees, {}, {"nodes"}, [this] {
        if (isMesh()) buckets_.release();
      }));
    }
    base::releaseFreedMemory(options_.limits.memory_bytes);
    return {};
  }

  base::Result<void> makeTile(const LeafSource& source, std::size_t tile) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto leaves, source.leaves(tile));
    Subtree tree = leaves.splats.empty() ? Subtree() : makeSubtree(leaves.splats, leaves.facets);
    tree.added_leaves = leaves.added;
    return subtrees_->add(static_cast<std::uint32_t>(tile), tree);
  }

  base::Result<void> write() {
    FileBuildOptions options;
    options.colors = source_.info.has_colors;
    options.threads = options_.limits.threads;
    options.runs_path = directory_->path() + "/runs";
    if (options_.coded) {
      LUMIGRID_TRY(directory_->needSpace(kOutputBytes * mostLeaves(), "the splat tree before it is coded"));
      options.plain_path = directory_->path() + "/plain";
    }
    options.progress = [this](const std::string& stage, double done) { return report(stage, done); };
    LUMIGRID_ASSIGN_OR_RETURN(auto header, writeTree(*subtrees_, output_path_, options));
    summary_.header = header;
    return {};
  }

  void fillSummary() {
    const ingest::SourceInfo& info = source_.info;
    summary_.origin = source_.origin;
    summary_.box_min = info.box_min;
    summary_.box_max = info.box_max;
    summary_.warnings = info.warnings;
    summary_.has_colors = info.has_colors;
    summary_.bytes = summary_.header.storedBytes();
    if (isMesh()) {
      summary_.triangles = buckets_.totals().triangles;
      summary_.facing = buckets_.totals().facing;
      ingest::addRepairs(source_, buckets_, summary_.repairs);
    } else {
      summary_.facing = point_leaves_->facing();
    }
    for (std::size_t t = 0; t < subtrees_->tiles(); ++t) summary_.added_leaves += (*subtrees_)[t].added_leaves;
    const std::uint64_t vertices = summary_.header.leaves - summary_.added_leaves;
    summary_.repairs.add("welded_vertices", info.referenced - std::min(info.referenced, vertices));
    summary_.seconds = watch_.seconds();
    summary_.cpu_seconds = watch_.cpuSeconds();
  }

  static constexpr std::uint64_t kDescriptors = 32;
  // Per leaf, and per triangle while they are sorted: measured on scans with colours.
  static constexpr std::uint64_t kOutputBytes = 10;
  static constexpr std::uint64_t kWorkBytes = 48;
  static constexpr std::uint64_t kBucketBytes = 60;
  static constexpr std::uint64_t kPointBytes = 16;
  static constexpr std::uint64_t kFittedBytes = 36;
  static constexpr double kLeavesPerCoreSecond = 0.6e6;

  BuildOptions options_;
  std::string output_path_;
  const ingest::Progress& progress_;
  std::mutex progress_mutex_;
  std::optional<ingest::WorkDirectory> directory_;
  const base::Stopwatch watch_;
  ingest::ImportedSource source_;
  ingest::SourceLattice lattice_;
  ingest::Buckets buckets_;
  std::optional<MeshLeaves> mesh_leaves_;
  PointTiles points_;
  std::optional<PointLeaves> point_leaves_;
  std::optional<SubtreeStore> subtrees_;
  BuildSummary summary_;
};

}  // namespace

base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(auto input, ingest::sourceFromFiles(paths, progress, options.limits.threads, true));
  auto summary = Builder(options, output_path, progress).run(input);
  // Work files that do not hold together are gone by now.
  if (!summary && ingest::isDamageError(summary.error())) summary = Builder(options, output_path, progress).run(input);
  return summary ? std::move(summary) : ingest::namingSource(paths, summary.error());
}

}  // namespace lod::qsplat::builder
