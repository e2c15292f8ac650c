#include "lod/hlod/builder/build.h"

#include <algorithm>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "base/memory.h"
#include "base/parallel.h"
#include "lod/hlod/builder/node_build.h"
#include "lod/hlod/builder/node_store.h"
#include "lod/hlod/builder/octree.h"
#include "lod/hlod/builder/ordered_triangles.h"

namespace lod::hlod::builder {
namespace {

using base::Error;
using base::ErrorCode;

// A node is made of the nodes this many levels below (section 3).
constexpr std::uint32_t kLevelsBelow = 2;

base::Result<void> check(const BuildOptions& options) {
  if (options.leaf_triangles == 0) return Error{ErrorCode::kInvalidInput, "a leaf needs at least one triangle"};
  if (!(options.resolution > 2.0F) || !(options.resolution <= 65536.0F))
    return Error{ErrorCode::kInvalidInput, "the resolution of nodes must be above 2, and at most 65536"};
  return {};
}

// One build, stage by stage. Each stage leaves in the work directory what the next one needs.
class HlodBuilder {
 public:
  HlodBuilder(const BuildOptions& options, std::string output_path, const ingest::Progress& progress)
      : options_(options), build_("nodes", options, std::move(output_path), progress) {}

  base::Result<BuildSummary> run(const ingest::SourceInput& input) {
    LUMIGRID_TRY(check(options_));
    LUMIGRID_TRY(build_.run(keyPrefix(), [&] { return runStages(input); }));
    build_.summarize(summary_);
    return std::move(summary_);
  }

 private:
  // All that decides the work files, their own format first. Threads and memory do not.
  std::string keyPrefix() const {
    std::string key = "hlod 5 " + ingest::describeStitch(options_.stitch);
    key += " " + std::to_string(options_.position_bits) + " " + std::to_string(options_.leaf_triangles) + " " +
           std::to_string(options_.resolution);
    key += " " + std::to_string(static_cast<int>(options_.appearance)) + (options_.points ? " points " : " ");
    return key;
  }

  base::Result<void> runStages(const ingest::SourceInput& input) {
    LUMIGRID_TRY(build_.importSource(input, options_.position_bits));
    const std::uint64_t triangles = build_.source().info.triangles;
    build_.reportPlan(kOutputBytes * triangles, kWorkBytes * triangles, triangles, kTrianglesPerCoreSecond);
    LUMIGRID_TRY(orderTriangles());
    chooseAppearance();
    LUMIGRID_TRY(makeNodes());
    return write();
  }

  ingest::WorkDirectory& directory() { return build_.directory(); }

  base::Result<void> orderTriangles() {
    LUMIGRID_ASSIGN_OR_RETURN(auto sorted, build_.sortTriangles({options_.stitch, false, ingest::Stage::kHlodOrdered}));
    const auto buckets = std::make_shared<ingest::Buckets>(std::move(sorted));
    ingest::addRepairs(build_.source(), *buckets, build_.lattice(), summary_);
    summary_.facing = buckets->totals().facing;
    const std::uint64_t stitched = buckets->totals().stitched.stitched_vertices;
    if (directory().isFinished(ingest::Stage::kHlodOrdered)) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto state, directory().readStageState(ingest::Stage::kHlodOrdered));
      base::ByteReader in(state);
      LUMIGRID_ASSIGN_OR_RETURN(triangles_, OrderedTriangles::open(directory().path(), in));
      auto cells = readCells(in);
      if (!cells) return directory().damaged();
      cells_ = std::move(*cells);
    } else {
      LUMIGRID_TRY(
          directory().needSpace(OrderedTriangles::kBytes * buckets->totals().triangles, "the triangles in order"));
      LUMIGRID_ASSIGN_OR_RETURN(triangles_, OrderedTriangles::order(*buckets, build_.lattice().bits, directory().path(),
                                                                    bucketsAtOnce(*buckets), [this](double done) {
                                                                      return build_.report("order", done);
                                                                    }));
      LUMIGRID_ASSIGN_OR_RETURN(cells_, makeOctree(triangles_, build_.lattice().bits, options_.leaf_triangles));
      base::ByteWriter state;
      triangles_.writeTables(state);
      writeCells(state, cells_);
      LUMIGRID_TRY(directory().finishStage(ingest::Stage::kHlodOrdered, state.takeBytes(), {"ordered"},
                                           [this, buckets] { build_.leaveBuckets(*buckets); }));
    }
    summary_.triangles = triangles_.count();
    summary_.repairs.add("duplicate_triangles", triangles_.duplicates());
    const std::uint64_t referenced = build_.source().info.referenced;
    summary_.repairs.add("welded_vertices", referenced - std::min(referenced, triangles_.vertices() + stitched));
    base::releaseFreedMemory(build_.memoryBytes());
    return {};
  }

  unsigned bucketsAtOnce(const ingest::Buckets& buckets) const {
    std::uint64_t largest = 1;
    for (std::size_t b = 0; b < buckets.count(); ++b) largest = std::max(largest, buckets.triangles(b));
    const std::uint64_t fit = build_.workMemory() / (kBucketBytesPerTriangle * largest);
    return static_cast<unsigned>(std::clamp<std::uint64_t>(fit, 1, build_.threads()));
  }

  void chooseAppearance() {
    const bool colors = triangles_.hasColors();
    node_options_.lattice = build_.lattice().lattice;
    node_options_.colors = colors;
    node_options_.points = options_.points;
    node_options_.resolution = options_.resolution;
    const Appearance chosen = options_.appearance;
    node_options_.appearance.colors = colors && (chosen == Appearance::kAuto || chosen == Appearance::kColors ||
                                                 chosen == Appearance::kColorsAndNormals);
    if (!colors && (chosen == Appearance::kColors || chosen == Appearance::kColorsAndNormals))
      summary_.warnings.push_back(
          std::string("the source has no colours, so ") +
          (chosen == Appearance::kColors ? "neither colours nor normals count" : "normals alone count") +
          " in the errors of hlod; with --appearance auto normals do");
    node_options_.appearance.normals = chosen == Appearance::kNormals || chosen == Appearance::kColorsAndNormals ||
                                       (chosen == Appearance::kAuto && !colors);
  }

  // Goes through Stage::kHlodNodes. Nodes are made level by level from the deepest on.
  base::Result<void> makeNodes() {
    LUMIGRID_ASSIGN_OR_RETURN(store_,
                              NodeStore::open(directory().path() + "/nodes", directory().has("nodes"), cells_.size()));
    const bool finished = directory().isFinished(ingest::Stage::kHlodNodes);
    const std::uint64_t triangles = triangles_.count();
    LUMIGRID_TRY(
        directory().needSpace(std::max(kStoreBytes * triangles, store_->bytes()) - store_->bytes(), "the nodes"));
    LUMIGRID_TRY(ingest::needOutputSpace(build_.outputPath(), kOutputBytes * triangles));
    for (std::uint32_t c = 0; c < cells_.size(); ++c) {
      if (finished && !store_->has(c)) return directory().damaged();
      if (store_->has(c)) done_ += cells_[c].count;
      all_ += cells_[c].count;
    }
    std::uint32_t end = static_cast<std::uint32_t>(cells_.size());
    while (end > 0) {
      std::uint32_t begin = end;
      while (begin > 0 && cells_[begin - 1].depth == cells_[end - 1].depth) --begin;
      LUMIGRID_TRY(makeLevel(begin, end));
      end = begin;
    }
    if (finished) return {};
    return directory().finishStage(ingest::Stage::kHlodNodes, {}, {"nodes"}, [this] { triangles_.release(); });
  }

  base::Result<void> makeLevel(std::uint32_t begin, std::uint32_t end) {
    std::vector<std::uint64_t> inputs;
    for (std::uint32_t c = begin; c < end; ++c) inputs.push_back(store_->has(c) ? 0 : inputBytes(c, kLevelsBelow));
    const std::vector<std::size_t> order = base::largestFirst(inputs);
    std::mutex mutex;
    std::condition_variable changed;
    std::uint64_t used = 0;  // bytes of the nodes that are worked on
    return base::tryParallelFor(order.size(), build_.threads(), [&](std::size_t i) -> base::Result<void> {
      const std::uint32_t cell = begin + static_cast<std::uint32_t>(order[i]);
      if (store_->has(cell)) return {};
      const std::uint64_t needed = inputs[order[i]];
      if (needed > build_.workMemory()) return tooLittleMemory(needed);
      {
        std::unique_lock lock(mutex);
        changed.wait(lock, [&] { return used + needed <= build_.workMemory(); });
        used += needed;
      }
      const auto made = makeNode(cell);
      const std::lock_guard lock(mutex);
      used -= needed;
      changed.notify_all();
      LUMIGRID_TRY(made);
      done_ += cells_[cell].count;
      const double share = static_cast<double>(done_) / static_cast<double>(all_);
      return build_.report("simplify", share) ? base::Result<void>() : build_.cancelled();
    });
  }

  // Memory that the node takes while it is made of what lies so many levels below.
  std::uint64_t inputBytes(std::uint32_t cell, std::uint32_t levels) const {
    const Cell& of = cells_[cell];
    // Nodes below were made before.
    const auto bytes = [&](std::uint64_t triangles) {
      const bool is_made = store_->has(cell);
      const std::uint64_t vertices = is_made ? store_->meshVertices(cell) : triangles / 2;
      const std::uint64_t points = is_made ? store_->meshPoints(cell) : 0;
      return kBytesPerTriangle * triangles + kBytesPerVertex * vertices + kBytesPerPoint * points;
    };
    if (of.isLeaf()) return bytes(of.count);
    if (levels == 0) return bytes(store_->meshTriangles(cell));
    std::uint64_t sum = 0;
    for (std::uint32_t k = 0; k < of.children; ++k) sum += inputBytes(of.first_child + k, levels - 1);
    return sum;
  }

  base::Error tooLittleMemory(std::uint64_t needed) const {
    return {ErrorCode::kNoSpace, "the memory given is too small for a node of the octree; give " +
                                     std::to_string((needed + ingest::kMinMemory / 2) / 1'000'000 + 1) +
                                     "M or more (--memory)"};
  }

  base::Result<void> add(std::uint32_t cell, const BuiltNode& node) {
    if (node.has_too_many)
      return Error{ErrorCode::kUnsupported, "a node of the octree has more than " + std::to_string(kMaxPrimitives) +
                                                " triangles or points: too many of the source's " +
                                                std::to_string(cells_[cell].count) +
                                                " triangles there are single ones, or lie in one place"};
    return store_->add(cell, node);
  }

  base::Result<void> makeNode(std::uint32_t cell) {
    const Cell& of = cells_[cell];
    if (of.isLeaf()) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto corners, triangles_.read(of.first, of.count));
      return add(cell, makeLeaf(sourceMesh(corners, node_options_.colors), node_options_));
    }
    std::vector<NodeMesh> parts;
    LUMIGRID_TRY(gather(cell, kLevelsBelow, parts));
    const float edge = std::exp2(static_cast<float>(build_.lattice().bits - of.depth));
    return add(cell, makeInnerNode(edge, parts, node_options_));
  }

  base::Result<void> gather(std::uint32_t cell, std::uint32_t levels, std::vector<NodeMesh>& parts) {
    const Cell& of = cells_[cell];
    if (of.isLeaf()) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto corners, triangles_.read(of.first, of.count));
      parts.push_back(sourceMesh(corners, node_options_.colors));
      return {};
    }
    if (levels == 0) {
      LUMIGRID_ASSIGN_OR_RETURN(auto mesh, store_->readMesh(cell));
      parts.push_back(std::move(mesh));
      return {};
    }
    for (std::uint32_t k = 0; k < of.children; ++k) LUMIGRID_TRY(gather(of.first_child + k, levels - 1, parts));
    return {};
  }

  base::Result<void> write() {
    Header header;
    header.colors = node_options_.colors;
    header.lattice = node_options_.lattice;
    const std::vector<Node> rows = linkedRows(*store_, cells_);
    for (std::uint32_t c = 0; c < cells_.size(); ++c) {
      if (summary_.levels.size() <= cells_[c].depth) summary_.levels.resize(cells_[c].depth + 1);
      if (rows[c].isLeaf()) header.source_triangles += rows[c].triangles;
      LevelSummary& level = summary_.levels[cells_[c].depth];
      ++level.nodes;
      level.triangles += rows[c].triangles;
      level.points += rows[c].points;
      level.caster_triangles += rows[c].caster_triangles;
      level.picture_bytes += rows[c].picture.bytes;
      level.caster_bytes += rows[c].caster.bytes;
      level.largest_error = std::max(level.largest_error, rows[c].error);
    }
    LUMIGRID_ASSIGN_OR_RETURN(summary_.header, writeFile(*store_, rows, header, build_.outputPath(),
                                                         [this](double done) { return build_.report("write", done); }));
    summary_.bytes = summary_.header.file_bytes;
    return {};
  }

  // Bytes per triangle of the source.
  static constexpr std::uint64_t kOutputBytes = 14;
  static constexpr std::uint64_t kStoreBytes = 40;
  static constexpr std::uint64_t kWorkBytes = 120;
  static constexpr double kTrianglesPerCoreSecond = 0.25e6;
  // Memory per triangle of a bucket that is put in order, and per triangle and vertex of those that a node is made of:
  // nodes of 0.3 to 3 million triangles with colours took 410 to 510 bytes of each, single triangles 1450.
  static constexpr std::uint64_t kBucketBytesPerTriangle = 220;
  static constexpr std::uint64_t kBytesPerTriangle = 430, kBytesPerVertex = 340;
  static constexpr std::uint64_t kBytesPerPoint = 300;

  const BuildOptions options_;
  ingest::StagedBuild build_;
  NodeOptions node_options_;
  OrderedTriangles triangles_;
  std::vector<Cell> cells_;
  std::optional<NodeStore> store_;
  std::uint64_t done_ = 0, all_ = 0;  // triangles below the nodes that are done, and below all
  BuildSummary summary_;
};

}  // namespace

base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto input, ingest::sourceFromFiles(paths, progress, options.limits.threads));
  return ingest::buildFromSource(paths, input, [&](const ingest::SourceInput& source) {
    return HlodBuilder(options, output_path, progress).run(source);
  });
}

}  // namespace lod::hlod::builder
