#include "lod/qsplat/builder/build.h"

#include <algorithm>
#include <mutex>
#include <optional>

#include "base/memory.h"
#include "base/parallel.h"
#include "lod/ingest/staged_build.h"
#include "lod/qsplat/builder/file_build.h"
#include "lod/qsplat/builder/mesh_leaves.h"
#include "lod/qsplat/builder/point_leaves.h"

namespace lod::qsplat::builder {
namespace {

using base::Error;
using base::ErrorCode;

// One build, stage by stage. Each stage leaves in the work directory what the next one needs.
class SplatTreeBuilder {
 public:
  SplatTreeBuilder(const BuildOptions& options, std::string output_path, const ingest::Progress& progress)
      : options_(options), build_("splat tree", options, std::move(output_path), progress) {}

  base::Result<BuildSummary> run(const ingest::SourceInput& input) {
    const std::string key_prefix =
        "qsplat 7 " + std::to_string(options_.dice) + " " + std::to_string(options_.position_bits) + " ";
    LUMIGRID_TRY(build_.run(key_prefix, [&] { return runStages(input); }));
    build_.summarize(summary_);
    return std::move(summary_);
  }

 private:
  base::Result<void> runStages(const ingest::SourceInput& input) {
    LUMIGRID_TRY(build_.importSource(input, options_.position_bits));
    const std::uint64_t leaves = info().referenced;
    build_.reportPlan(kOutputBytes * leaves, kBucketBytes * info().triangles + kWorkBytes * leaves, leaves,
                      kLeavesPerCoreSecond);
    LUMIGRID_TRY(isMesh() ? sortTriangles() : sortPoints());
    LUMIGRID_TRY(isMesh() ? measureBorder() : orientPoints());
    LUMIGRID_TRY(makeSubtrees());
    LUMIGRID_TRY(write());
    fillSummary();
    return {};
  }

  const ingest::SourceInfo& info() const { return build_.source().info; }
  bool isMesh() const { return info().triangles > 0; }

  base::Result<void> sortTriangles() {
    LUMIGRID_ASSIGN_OR_RETURN(buckets_, build_.sortTriangles({{.on = false}, false, {}}));
    return {};
  }

  // Goes through Stage::kSplatLeaves of a mesh.
  base::Result<void> measureBorder() {
    auto& leaves = mesh_leaves_.emplace(buckets_, build_.lattice(), options_.dice);
    if (build_.directory().isFinished(ingest::Stage::kSplatLeaves)) {
      LUMIGRID_ASSIGN_OR_RETURN(auto state, build_.directory().readStageState(ingest::Stage::kSplatLeaves));
      base::ByteReader in(state);
      return leaves.readBorder(in) && in.atEnd() ? base::Result<void>() : build_.directory().damaged();
    }
    LUMIGRID_TRY(
        leaves.measureBorder(tilesAtOnce(leaves), [this](double done) { return build_.report("borders", done); }));
    base::ByteWriter out;
    leaves.writeBorder(out);
    return build_.directory().finishStage(ingest::Stage::kSplatLeaves, out.takeBytes(), {});
  }

  // Goes through Stage::kSorted of points.
  base::Result<void> sortPoints() {
    if (build_.directory().isFinished(ingest::Stage::kSorted)) {
      LUMIGRID_ASSIGN_OR_RETURN(auto state, build_.directory().readStageState(ingest::Stage::kSorted));
      LUMIGRID_ASSIGN_OR_RETURN(points_, ingest::PointTiles::open(build_.directory().path(), build_.lattice(), state));
      return {};
    }
    LUMIGRID_TRY(build_.directory().needSpace(kPointBytes * info().vertices, "the points sorted by tiles"));
    LUMIGRID_ASSIGN_OR_RETURN(auto spool, build_.openSpool());
    LUMIGRID_ASSIGN_OR_RETURN(points_,
                              ingest::PointTiles::sort(spool, info(), build_.lattice(), build_.directory().path(),
                                                       [this](double done) { return build_.report("sort", done); }));
    LUMIGRID_TRY(build_.directory().finishStage(ingest::Stage::kSorted, points_.encodeTables(), {"points"},
                                                build_.spoolLeaver()));
    base::releaseFreedMemory(build_.memoryBytes());
    return {};
  }

  // Goes through Stage::kSplatLeaves of points.
  base::Result<void> orientPoints() {
    auto& leaves = point_leaves_.emplace(points_, build_.lattice(), info().has_normals);
    for (std::size_t t = 0; t < leaves.tiles(); ++t)
      if (leaves.memoryOf(t) > build_.workMemory())
        return Error{ErrorCode::kNoSpace, "the memory given is too small: " + std::to_string(points_.points(t)) +
                                              " points lie in nearly one place (--memory)"};
    const std::string path = build_.directory().path() + "/leaves";
    if (build_.directory().isFinished(ingest::Stage::kSplatLeaves)) {
      LUMIGRID_ASSIGN_OR_RETURN(auto state, build_.directory().readStageState(ingest::Stage::kSplatLeaves));
      base::ByteReader in(state);
      return leaves.reopen(path, in);
    }
    LUMIGRID_TRY(build_.directory().needSpace(kFittedBytes * info().vertices, "the fitted points"));
    LUMIGRID_TRY(
        leaves.fitAll(path, tilesAtOnce(leaves), [this](double done) { return build_.report("normals", done); }));
    base::ByteWriter out;
    leaves.writeSigns(out);
    return build_.directory().finishStage(ingest::Stage::kSplatLeaves, out.takeBytes(), {"leaves"},
                                          [this] { points_.release(); });
  }

  const LeafSource& leafSource() const {
    return isMesh() ? static_cast<const LeafSource&>(*mesh_leaves_) : *point_leaves_;
  }

  // How many tiles the memory holds at a time.
  unsigned tilesAtOnce(const LeafSource& leaves) const {
    std::uint64_t largest = 1;
    for (std::size_t t = 0; t < leaves.tiles(); ++t) largest = std::max(largest, leaves.memoryOf(t));
    return static_cast<unsigned>(std::clamp<std::uint64_t>(build_.workMemory() / largest, 1, build_.threads()));
  }

  std::uint64_t maxLeaves() const { return info().referenced + (isMesh() ? mesh_leaves_->maxAddedLeaves() : 0); }

  // Goes through Stage::kSplatSubtrees.
  base::Result<void> makeSubtrees() {
    const LeafSource& leaves = leafSource();
    const std::string path = build_.directory().path() + "/nodes";
    LUMIGRID_ASSIGN_OR_RETURN(subtrees_, SubtreeStore::open(path, build_.directory().has("nodes"), leaves.tiles()));
    LUMIGRID_TRY(build_.directory().needSpace(
        std::max(kWorkBytes * maxLeaves(), subtrees_->bytes()) - subtrees_->bytes(), "the splat tree"));
    LUMIGRID_TRY(ingest::needOutputSpace(build_.outputPath(), kOutputBytes * maxLeaves()));
    std::size_t done = 0;
    for (std::size_t t = 0; t < leaves.tiles(); ++t) {
      done += subtrees_->has(t) ? 1 : 0;
      if (!subtrees_->has(t) && build_.directory().isFinished(ingest::Stage::kSplatSubtrees))
        return build_.directory().damaged();
    }
    std::mutex mutex;
    const auto addTile = [&](std::size_t t) -> base::Result<void> {
      if (subtrees_->has(t)) return {};
      LUMIGRID_TRY(makeTile(leaves, t));
      const std::lock_guard lock(mutex);
      const bool more = build_.report("tree", static_cast<double>(++done) / static_cast<double>(leaves.tiles()));
      return more ? base::Result<void>() : build_.cancelled();
    };
    LUMIGRID_TRY(base::tryParallelFor(leaves.tiles(), tilesAtOnce(leaves), addTile));
    // From here on only the store is needed.
    if (!build_.directory().isFinished(ingest::Stage::kSplatSubtrees)) {
      LUMIGRID_TRY(build_.directory().finishStage(ingest::Stage::kSplatSubtrees, {}, {"nodes"}, [this] {
        if (isMesh()) buckets_.release();
      }));
    }
    base::releaseFreedMemory(build_.memoryBytes());
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
    options.colors = info().has_colors;
    options.points = !isMesh();
    options.threads = build_.threads();
    options.runs_path = build_.directory().path() + "/runs";
    if (options_.coded) {
      LUMIGRID_TRY(build_.directory().needSpace(kOutputBytes * maxLeaves(), "the splat tree before it is coded"));
      options.plain_path = build_.directory().path() + "/plain";
    }
    options.progress = [this](const std::string& stage, double done) { return build_.report(stage, done); };
    LUMIGRID_ASSIGN_OR_RETURN(const auto written, writeTree(*subtrees_, build_.outputPath(), options));
    summary_.header = written.header;
    summary_.added_leaves = written.repeated_leaves;
    return {};
  }

  void fillSummary() {
    summary_.bytes = summary_.header.storedBytes();
    if (isMesh()) {
      summary_.triangles = buckets_.totals().triangles;
      summary_.facing = buckets_.totals().facing;
      ingest::addRepairs(build_.source(), buckets_, build_.lattice(), summary_);
    } else {
      summary_.facing = point_leaves_->facing();
    }
    for (std::size_t t = 0; t < subtrees_->tiles(); ++t) summary_.added_leaves += (*subtrees_)[t].added_leaves;
    const std::uint64_t vertices = summary_.header.leaves - summary_.added_leaves;
    const std::uint64_t welded = info().referenced - std::min(info().referenced, vertices);
    summary_.repairs.add("welded_vertices", welded);
    if (std::string lost = ingest::lostPoints(info(), build_.lattice(), welded); !lost.empty())
      summary_.warnings.push_back(std::move(lost));
  }

  // Bytes per leaf, or per triangle in buckets, measured on scans with colours.
  static constexpr std::uint64_t kOutputBytes = 10;
  static constexpr std::uint64_t kWorkBytes = 48;
  static constexpr std::uint64_t kBucketBytes = 60;
  static constexpr std::uint64_t kPointBytes = 16;
  static constexpr std::uint64_t kFittedBytes = 36;
  static constexpr double kLeavesPerCoreSecond = 0.6e6;

  BuildOptions options_;
  ingest::StagedBuild build_;
  ingest::Buckets buckets_;
  std::optional<MeshLeaves> mesh_leaves_;
  ingest::PointTiles points_;
  std::optional<PointLeaves> point_leaves_;
  std::optional<SubtreeStore> subtrees_;
  BuildSummary summary_;
};

}  // namespace

base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto input, ingest::sourceFromFiles(paths, progress, options.limits.threads, true));
  return ingest::buildFromSource(paths, input, [&](const ingest::SourceInput& source) {
    return SplatTreeBuilder(options, output_path, progress).run(source);
  });
}

}  // namespace lod::qsplat::builder
