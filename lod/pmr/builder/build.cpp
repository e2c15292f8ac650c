#include "lod/pmr/builder/build.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <optional>

#include "base/memory.h"
#include "base/parallel.h"
#include "lod/ingest/point_tiles.h"
#include "lod/pmr/builder/block.h"
#include "lod/pmr/builder/leaf_store.h"
#include "lod/pmr/builder/octree.h"
#include "lod/pmr/builder/umbrellas.h"

namespace lod::pmr::builder {
namespace {

using base::Error;
using base::ErrorCode;

// One build, stage by stage. Each stage leaves in the work directory what the next one needs.
class PmrBuilder {
 public:
  PmrBuilder(const BuildOptions& options, std::string output_path, const ingest::Progress& progress)
      : build_("points and umbrellas", options, std::move(output_path), progress) {}

  base::Result<BuildSummary> run(const ingest::SourceInput& input) {
    LUMIGRID_TRY(build_.run("pmr 4 ", [&] { return runStages(input); }));
    build_.summarize(summary_);
    return std::move(summary_);
  }

 private:
  base::Result<void> runStages(const ingest::SourceInput& input) {
    LUMIGRID_TRY(build_.importSource(input, ingest::kMaxLatticeBits));
    build_.reportPlan(kOutputBytes * info().referenced, kWorkBytes * info().referenced, info().referenced,
                      kPointsPerCoreSecond);
    LUMIGRID_TRY(order());
    LUMIGRID_TRY(planBlocks());
    LUMIGRID_TRY(classifyBlocks());
    LUMIGRID_TRY(makeAllLeaves());
    return write();
  }

  const ingest::SourceInfo& info() const { return build_.source().info; }
  ingest::WorkDirectory& directory() { return build_.directory(); }
  std::string pathOf(const std::string& name) { return directory().path() + "/" + name; }

  // Goes through Stage::kSorted and Stage::kPmrOrdered.
  base::Result<void> order() {
    if (directory().isFinished(ingest::Stage::kPmrOrdered)) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto state, directory().readStageState(ingest::Stage::kPmrOrdered));
      LUMIGRID_ASSIGN_OR_RETURN(points_, OrderedPoints::open(directory().path(), state));
      return {};
    }
    const bool is_sorted = directory().isFinished(ingest::Stage::kSorted);
    LUMIGRID_TRY(directory().needSpace((is_sorted ? 1 : 2) * kPointBytes * info().referenced, "the points in order"));
    LUMIGRID_ASSIGN_OR_RETURN(auto tiles, sortPoints());
    const auto sorted = std::make_shared<ingest::PointTiles>(std::move(tiles));
    LUMIGRID_ASSIGN_OR_RETURN(points_,
                              OrderedPoints::order(*sorted, build_.lattice().lattice, directory().path(),
                                                   [this](double done) { return build_.report("order", done); }));
    LUMIGRID_TRY(directory().finishStage(ingest::Stage::kPmrOrdered, points_.encodeTables(), {"ordered"},
                                         [sorted] { sorted->release(); }));
    base::releaseFreedMemory(build_.memoryBytes());
    return {};
  }

  base::Result<ingest::PointTiles> sortPoints() {
    if (directory().isFinished(ingest::Stage::kSorted)) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto state, directory().readStageState(ingest::Stage::kSorted));
      return ingest::PointTiles::open(directory().path(), build_.lattice(), state);
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto spool, build_.openSpool());
    LUMIGRID_ASSIGN_OR_RETURN(auto tiles,
                              ingest::PointTiles::sort(spool, info(), build_.lattice(), directory().path(),
                                                       [this](double done) { return build_.report("sort", done); }));
    LUMIGRID_TRY(
        directory().finishStage(ingest::Stage::kSorted, tiles.encodeTables(), {"points"}, build_.spoolLeaver()));
    return tiles;
  }

  base::Result<void> planBlocks() {
    blocks_ = makeBlocks(points_.cells());
    std::uint64_t largest = 1;
    needed_.clear();
    for (const CellBlock& block : blocks_) {
      std::uint64_t points = 0;
      for (std::uint32_t c = block.first; c < block.end; ++c) points += points_.cells()[c].count;
      std::uint64_t around = 0;
      for (const std::uint32_t c : block.around) around += pointsInReach(block, points_.cells()[c]);
      largest = std::max(largest, points + around);
      needed_.push_back(kBlockBytesPerPoint * (points + around));
    }
    if (largest >= Triangle::kMaxPoints)
      return Error{ErrorCode::kUnsupported, std::to_string(largest) + " points lie in nearly one place"};
    const std::uint64_t needed = kBlockBytesPerPoint * largest;
    if (needed > build_.workMemory())
      return Error{ErrorCode::kNoSpace,
                   "the memory given is too small for " + std::to_string(largest) + " points at a time; give " +
                       std::to_string((needed + ingest::kMinMemory / 2) / 1'000'000 + 1) + "M or more (--memory)"};
    return {};
  }

  // About how many points of a cell around a block are loaded with it: half, or all where one of the block's cells near
  // it is at least twice as wide, so that its surroundings reach through.
  std::uint64_t pointsInReach(const CellBlock& block, const OctreeCell& cell) const {
    const auto own = points_.cells().begin();
    const bool reaches_through = std::any_of(own + block.first, own + block.end, [&](const OctreeCell& one) {
      return one.edge() >= 2 * cell.edge() && one.box().withSurroundings().touches(cell.box());
    });
    return reaches_through ? cell.count : cell.count / 2;
  }

  // Calls work(block) for each block that is not done, as many at a time as memory has room for. Each fits alone:
  // planBlocks().
  template <class Store, class Work>
  base::Result<void> forEachBlock(const std::string& stage, const Store& store, const Work& work) {
    std::size_t done = 0;
    for (std::size_t b = 0; b < blocks_.size(); ++b) done += store.has(b) ? 1 : 0;
    std::mutex mutex;
    std::condition_variable changed;
    std::uint64_t used = 0;  // bytes of the blocks that are worked on
    return base::tryParallelFor(blocks_.size(), build_.threads(), [&](std::size_t b) -> base::Result<void> {
      if (store.has(b)) return {};
      {
        std::unique_lock lock(mutex);
        changed.wait(lock, [&] { return used + needed_[b] <= build_.workMemory(); });
        used += needed_[b];
      }
      const auto worked = work(static_cast<std::uint32_t>(b));
      const std::lock_guard lock(mutex);
      used -= needed_[b];
      changed.notify_all();
      LUMIGRID_TRY(worked);
      const bool more = build_.report(stage, static_cast<double>(++done) / static_cast<double>(blocks_.size()));
      return more ? base::Result<void>() : build_.cancelled();
    });
  }

  // Goes through Stage::kPmrClasses.
  base::Result<void> classifyBlocks() {
    LUMIGRID_ASSIGN_OR_RETURN(
        classes_, ClassStore::open(pathOf("classes"), directory().has("classes"), points_.cells(), blocks_));
    const bool finished = directory().isFinished(ingest::Stage::kPmrClasses);
    LUMIGRID_TRY(forEachBlock("voronoi", *classes_, [&](std::uint32_t b) -> base::Result<void> {
      if (finished) return directory().damaged();
      LUMIGRID_ASSIGN_OR_RETURN(const auto classes, classify(points_, blocks_[b]));
      return classes_->add(b, classes);
    }));
    if (finished) return {};
    return directory().finishStage(ingest::Stage::kPmrClasses, {}, {"classes"});
  }

  // Goes through Stage::kPmrLeaves.
  base::Result<void> makeAllLeaves() {
    LUMIGRID_ASSIGN_OR_RETURN(leaves_, LeafStore::open(pathOf("leaves"), directory().has("leaves"), blocks_));
    LUMIGRID_TRY(directory().needSpace(std::max(kOutputBytes * points_.points(), leaves_->bytes()) - leaves_->bytes(),
                                       "the umbrellas"));
    LUMIGRID_TRY(ingest::needOutputSpace(build_.outputPath(), kOutputBytes * points_.points()));
    const bool finished = directory().isFinished(ingest::Stage::kPmrLeaves);
    LUMIGRID_TRY(forEachBlock("umbrellas", *leaves_, [&](std::uint32_t b) -> base::Result<void> {
      if (finished) return directory().damaged();
      LUMIGRID_ASSIGN_OR_RETURN(const auto leaves, makeLeaves(points_, *classes_, blocks_[b], info().has_colors));
      return leaves_->add(b, leaves);
    }));
    if (!finished)
      LUMIGRID_TRY(directory().finishStage(ingest::Stage::kPmrLeaves, {}, {"leaves"}, [this] { points_.release(); }));
    base::releaseFreedMemory(build_.memoryBytes());
    return {};
  }

  base::Result<void> write() {
    const auto leaves = leaves_->leaves();
    Header header;
    header.colors = info().has_colors;
    header.oriented = points_.haveNormals();
    header.lattice = points_.lattice();
    LUMIGRID_ASSIGN_OR_RETURN(summary_.header, writeFile(*leaves_, leaves, header, build_.outputPath(),
                                                         [this](double done) { return build_.report("write", done); }));
    for (const auto& one : leaves) {
      summary_.outliers += one.unused;
      std::uint64_t points = 0;
      for (std::uint32_t level = kLevels; level-- > 0;) {
        points += one.leaf.levels[level].points;
        summary_.points[level] += points;
        summary_.triangles[level] += one.leaf.levels[level].triangles;
      }
    }
    summary_.duplicates = info().referenced - std::min(info().referenced, summary_.header.points);
    summary_.repairs.add("welded_vertices", summary_.duplicates);
    if (std::string lost = ingest::lostPoints(info(), build_.lattice(), summary_.duplicates); !lost.empty())
      summary_.warnings.push_back(std::move(lost));
    summary_.bytes = summary_.header.file_bytes;
    return {};
  }

  // Bytes per point, measured on scans with colours.
  static constexpr std::uint64_t kPointBytes = 16;
  static constexpr std::uint64_t kOutputBytes = 24;
  static constexpr std::uint64_t kWorkBytes = 60;
  static constexpr double kPointsPerCoreSecond = 0.03e6;

  ingest::StagedBuild build_;
  OrderedPoints points_;
  std::vector<CellBlock> blocks_;
  std::vector<std::uint64_t> needed_;  // bytes, by block
  std::optional<ClassStore> classes_;
  std::optional<LeafStore> leaves_;
  BuildSummary summary_;
};

}  // namespace

base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto input, ingest::sourceFromFiles(paths, progress, options.limits.threads, true));
  return ingest::buildFromSource(paths, input, [&](const ingest::SourceInput& source) {
    return PmrBuilder(options, output_path, progress).run(source);
  });
}

}  // namespace lod::pmr::builder
