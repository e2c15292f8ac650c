#include "lod/patch/builder/hierarchy_build.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <limits>
#include <mutex>
#include <optional>
#include <span>

#include "base/error.h"
#include "base/file.h"
#include "base/parallel.h"
#include "lod/ingest/buckets.h"
#include "lod/ingest/code_map.h"
#include "lod/ingest/staged_build.h"
#include "lod/patch/builder/leaf_textures.h"
#include "lod/patch/builder/levels.h"
#include "lod/patch/builder/patch_split.h"
#include "lod/patch/codec.h"
#include "lod/patch/format.h"

namespace lod::patch::builder {
namespace {

using base::Error;
using base::ErrorCode;

base::Result<void> check(const HierarchyOptions& options) {
  // Three vertices a triangle must fit 16-bit indices, and a voxel must fit a patch.
  constexpr std::uint32_t kMax = kMaxPatchVertices / 3;
  auto inRange = [](std::uint32_t value, std::uint32_t low, std::uint32_t high) {
    return low <= value && value <= high;
  };
  if (!inRange(options.leaf_triangles, 16, kMax) || !inRange(options.node_triangles, 16, kMax))
    return Error{ErrorCode::kInvalidInput, "triangles per patch must be 16 to " + std::to_string(kMax)};
  if (!inRange(options.voxel_triangles, 1, options.leaf_triangles))
    return Error{ErrorCode::kInvalidInput, "triangles per voxel must be 1 to the triangles per leaf patch"};
  if (!inRange(options.group_patches, 2, 64))
    return Error{ErrorCode::kInvalidInput, "patches per group must be 2 to 64"};
  return ingest::checkPositionBits(options.position_bits);
}

// ---- leaf patches of a bucket ----

// Triangles are requested so far ahead, since they lie anywhere in memory.
constexpr std::size_t kPrefetchDistance = 24;

using Triple = std::array<std::uint32_t, 3>;

// The corners from the smallest on, in their winding.
Triple rotated(const std::uint32_t* c) {
  if (c[0] < c[1] && c[0] < c[2]) return {c[0], c[1], c[2]};
  return c[1] < c[2] ? Triple{c[1], c[2], c[0]} : Triple{c[2], c[0], c[1]};
}

// Whether two of the triangles may be the same. For a few of them the sums of their corners mostly tell.
bool mayHoldDuplicates(const CodedMesh& mesh, std::span<const ingest::KeyedIndex> triangles) {
  constexpr std::size_t kFew = 8;  // a choice: at most 28 pairs of sums are compared
  if (triangles.size() > kFew) return true;
  std::array<std::uint64_t, kFew> sums{};
  bool alike = false;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const std::uint32_t* c = &mesh.indices[3 * std::size_t{triangles[i].index}];
    sums[i] = std::uint64_t{c[0]} + c[1] + c[2];
    for (std::size_t j = 0; j < i; ++j) alike |= sums[i] == sums[j];
  }
  return alike;
}

// Keeps the first of triangles with the same corners and winding. They share a median code, so they lie together.
std::uint64_t dropDuplicates(const CodedMesh& mesh, std::vector<ingest::KeyedIndex>& sorted) {
  std::vector<std::pair<Triple, std::uint32_t>> same;
  std::vector<std::uint8_t> drop(sorted.size(), 0);
  std::uint64_t dropped = 0;
  for (std::size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    while (end < sorted.size() && sorted[end].key == sorted[begin].key) ++end;
    if (end - begin < 2 || !mayHoldDuplicates(mesh, std::span(sorted).subspan(begin, end - begin))) continue;
    same.clear();
    for (std::size_t i = begin; i < end; ++i)
      same.emplace_back(rotated(&mesh.indices[3 * std::size_t{sorted[i].index}]), static_cast<std::uint32_t>(i));
    std::sort(same.begin(), same.end());
    for (std::size_t i = 1; i < same.size(); ++i)
      if (same[i].first == same[i - 1].first) drop[same[i].second] = 1, ++dropped;
  }
  if (dropped == 0) return 0;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < sorted.size(); ++i)
    if (drop[i] == 0) sorted[kept++] = sorted[i];
  sorted.resize(kept);
  return dropped;
}

// Numbers the mesh's vertices in the order in which the sorted triangles use them.
void numberVertices(const ingest::Buckets::NumberedBucket& read, std::span<const ingest::KeyedIndex> sorted,
                    CodedMesh& mesh) {
  mesh.indices.resize(3 * sorted.size());
  std::uint32_t* index = mesh.indices.data();
  const auto first = [&](std::size_t i) { return 3 * std::size_t{sorted[std::min(i, sorted.size() - 1)].index}; };
  // Vertices that have a number in the bucket get a new one; without numbers, their codes identify them.
  if (const std::vector<std::uint32_t>& known = read.mesh.number; !known.empty()) {
    std::vector<std::uint32_t> number(read.mesh.codes.size(), ingest::CodeMap::kNone);
    mesh.codes.reserve(number.size());
    for (std::size_t i = 0; i < sorted.size(); ++i) {
      __builtin_prefetch(&known[first(i + kPrefetchDistance)]);
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t v = known[first(i) + k];
        if (number[v] == ingest::CodeMap::kNone) {
          number[v] = static_cast<std::uint32_t>(mesh.codes.size());
          mesh.codes.push_back(read.mesh.codes[v]);
        }
        *index++ = number[v];
      }
    }
    return;
  }
  ingest::CodeMap map(read.corners.size() / 6);
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    __builtin_prefetch(&read.corners[first(i + kPrefetchDistance)]);
    const ingest::Corner* ahead = &read.corners[first(i + ingest::CodeMap::kPrefetchDistance / 3)];
    for (std::size_t k = 0; k < 3; ++k) map.prefetch(ahead[k].code);
    const ingest::Corner* c = &read.corners[first(i)];
    for (std::size_t k = 0; k < 3; ++k) *index++ = map.insert(c[k].code).first;
  }
  mesh.codes = map.releaseCodes();
}

struct BucketLeaves {
  std::vector<NewPatch> patches;
  std::uint64_t duplicates = 0;  // triangles left out, since one with the same corners and winding is there
  std::uint64_t vertices = 0;    // used by this bucket
};

// Makes leaf patches of a bucket of triangles: drops duplicates, averages attributes at each lattice point, and
// partitions the graph of voxels (Okamoto 2011, section 4.1, steps 1 and 2). Errors: those of reading the bucket.
//
// `normals`: those that the levels above store. With kOfFacets no light shows any, so that edges need not be told from
// curves by the leaves' either.
//
// Leaf patches do not cross bucket borders. The paper partitions one graph of all voxels; here each bucket has its own,
// so that memory does not grow with the mesh. The groups of the next level cross bucket borders like any other.
base::Result<BucketLeaves> makeLeaves(const ingest::Buckets& buckets, std::size_t bucket,
                                      const ingest::SourceLattice& lattice, const HierarchyOptions& options,
                                      StoredNormals normals) {
  BucketLeaves out;
  if (buckets.triangles(bucket) == 0) return out;
  LUMIGRID_ASSIGN_OR_RETURN(auto read, buckets.readKept(bucket));

  // Triangles are sorted by voxels first, so that later steps find neighbours side by side.
  const std::size_t triangles = read.corners.size() / 3;
  std::vector<ingest::KeyedIndex> sorted(triangles);
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const ingest::Corner* c = &read.corners[3 * std::size_t{t}];
    sorted[t] = {ingest::medianCode(c[0].code, c[1].code, c[2].code), t};
  }
  ingest::radixSort(sorted, 3 * lattice.bits);

  CodedMesh mesh;
  numberVertices(read, sorted, mesh);
  const std::size_t vertices = mesh.codes.size();
  mesh.positions.reserve(vertices);
  for (const std::uint64_t code : mesh.codes) mesh.positions.push_back(ingest::mortonPoint(code));
  // For a mesh without colours and normals only the facets are summed, which takes less memory traffic.
  const bool attributes = buckets.hasColors() || buckets.hasNormals();
  std::vector<ingest::VertexSums> sums(attributes ? vertices : 0);
  std::vector<ingest::FacetSums> facets(attributes ? 0 : vertices);
  for (std::size_t i = 0; i < triangles; ++i) {
    const std::uint32_t* v = &mesh.indices[3 * i];
    const auto facet = ingest::facetAtCorners(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]]);
    if (!attributes) {
      for (std::size_t k = 0; k < 3; ++k) facets[v[k]] += facet[k];
      continue;
    }
    __builtin_prefetch(&read.corners[3 * std::size_t{sorted[std::min(i + kPrefetchDistance, triangles - 1)].index}]);
    for (std::size_t k = 0; k < 3; ++k) sums[v[k]].add(facet[k], read.corners[3 * std::size_t{sorted[i].index} + k]);
  }
  std::vector<std::uint64_t> sources;
  if (buckets.hasTextures()) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto in_bucket, buckets.sources(bucket));
    for (const ingest::KeyedIndex& t : sorted) sources.push_back(in_bucket[t.index]);
  }
  for (std::uint32_t t = 0; t < triangles; ++t) sorted[t].index = t;
  read = {};

  // Border vertices get the sums of all buckets.
  std::vector<std::uint8_t> outer(vertices, 0);
  const ingest::BorderVertices& border = buckets.border();
  mesh.normals.reserve(vertices);
  if (buckets.hasColors()) mesh.colors.reserve(vertices);
  for (std::size_t v = 0; v < vertices; ++v) {
    ingest::VertexSums sum = attributes ? sums[v] : ingest::VertexSums{facets[v]};
    if (const std::int64_t at = border.find(mesh.codes[v]); at >= 0) {
      outer[v] = 1;
      sum = border.sums[static_cast<std::size_t>(at)];
    }
    mesh.normals.push_back(sum.unitNormal(normals == StoredNormals::kOfVertices));
    if (buckets.hasColors()) mesh.colors.push_back(quantizedColor(sum.meanColor()));
  }
  sums = std::vector<ingest::VertexSums>();
  facets = std::vector<ingest::FacetSums>();
  quantizeNormals(mesh.normals);
  out.vertices = mesh.codes.size();

  out.duplicates = dropDuplicates(mesh, sorted);
  const auto parts =
      splitTriangles(mesh, sorted, lattice.bits, options.voxel_triangles, options.leaf_triangles, TieWeight::kNormals);
  const base::ByteView carried(reinterpret_cast<const std::uint8_t*>(sources.data()), kSourceBytes * sources.size());
  out.patches = makePatches(mesh, parts, outer, carried, lattice.lattice, 0);
  return out;
}

// ---- the build ----

// Numbers the hierarchy: groups from the top level down after the virtual group 0, patches by the group that consumes
// them.
class Numbering {
 public:
  Numbering(const std::vector<WorkPatch>& patches, const std::vector<WorkGroup>& groups)
      : patches_(patches), groups_(groups) {
    // Work groups were built level by level, bottom up.
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
  // Group 0 is always expanded and consumes the last patch built. Its sphere contains everything, as the top group's
  // does.
  void addRoot(Hierarchy& hierarchy) const {
    Group root;
    const WorkPatch& top = patches_.back();
    root.bounds = groups_.empty() ? top.record.bounds : groups_.back().record.bounds;
    root.error = root.typical_error = root.visible_error = std::numeric_limits<float>::infinity();
    root.attribute_error = groups_.empty() ? 0.0F : groups_.back().record.attribute_error;
    root.level = top.record.level + 1;
    root.patch_count = 1;
    hierarchy.groups.push_back(root);
  }

  void addGroup(Hierarchy& hierarchy, const WorkGroup& work) const {
    Group group = work.record;
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
    Patch patch = work.record;
    patch.consumer = consumerOf(work);
    if (patch.producer != kNoGroup) patch.producer = group_number_[patch.producer];
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

// One build, stage by stage. Each stage leaves in the work directory what the next one needs.
class HierarchyBuilder {
 public:
  HierarchyBuilder(const HierarchyOptions& options, std::string output_path, const ingest::Progress& progress)
      : options_(options), build_("patch hierarchy", options, std::move(output_path), progress) {
    options_.limits = options_.limits.resolved();
  }

  base::Result<HierarchySummary> run(const ingest::SourceInput& input) {
    LUMIGRID_TRY(check(options_));
    LUMIGRID_TRY(build_.run(keyPrefix(), [&] { return runStages(input); }));
    build_.summarize(summary_);
    return std::move(summary_);
  }

 private:
  base::Result<void> runStages(const ingest::SourceInput& input) {
    LUMIGRID_TRY(build_.importSource(input, options_.position_bits));
    const std::uint64_t triangles = build_.source().info.triangles;
    build_.reportPlan(kOutputBytes * triangles, kWorkBytes * triangles, triangles, kTrianglesPerCoreSecond);
    LUMIGRID_ASSIGN_OR_RETURN(buckets_,
                              build_.sortTriangles({options_.stitch, keepsTextures(), ingest::Stage::kPatchLeaves}));
    std::vector<WorkPatch> leaves;
    LUMIGRID_TRY(openStore());
    LUMIGRID_TRY(makeAllLeaves(leaves));
    LUMIGRID_TRY(makeTextures(leaves));
    LUMIGRID_TRY(makeLevels(std::move(leaves)));
    LUMIGRID_TRY(write());
    fillSummary();
    return {};
  }

  // The key holds everything that determines the work files, their own format first. Threads and memory do not.
  std::string keyPrefix() const {
    std::string key = (keepsTextures() ? "20 textures " : "19 ") + ingest::describeStitch(options_.stitch);
    for (const std::uint32_t v : {options_.voxel_triangles, options_.leaf_triangles, options_.node_triangles,
                                  options_.group_patches, options_.position_bits, options_.regroup ? 1U : 0U}) {
      key += ' ';
      key += std::to_string(v);
    }
    return key + ' ';
  }

  base::Result<void> openStore() {
    const auto keep = [this](const WorkUnit& unit, std::vector<WorkPatch> patches) {
      known_.emplace_back(unit, std::move(patches));
    };
    LUMIGRID_ASSIGN_OR_RETURN(
        store_, WorkStore::open(build_.directory().path() + "/patches", build_.directory().has("patches"), keep));
    // Still to come are about 7 bytes for each of twice the triangles, and the same again as patch.lgp.
    LUMIGRID_TRY(build_.directory().needSpace(
        std::max<std::uint64_t>(14 * buckets_.totals().triangles, store_->bytes()) - store_->bytes(), "the patches"));
    return ingest::needOutputSpace(build_.outputPath(), kOutputBytes * buckets_.totals().triangles);
  }

  base::Result<void> makeAllLeaves(std::vector<WorkPatch>& leaves) {
    std::vector<std::vector<WorkPatch>> made(buckets_.count());
    std::vector<std::uint8_t> finished(buckets_.count(), 0);
    auto note = [this](const WorkUnit& unit) {
      duplicates_ += unit.group.first_patch;
      inner_vertices_ += unit.group.block_offset;
    };
    std::uint64_t done = 0;
    std::vector<std::uint64_t> triangles(made.size());
    for (auto& [unit, patches] : known_) {
      if (unit.level != 0 || unit.index >= made.size()) continue;
      note(unit);
      made[unit.index] = std::move(patches);
      finished[unit.index] = 1;
      done += buckets_.triangles(unit.index);
    }
    for (std::size_t b = 0; b < made.size(); ++b) {
      triangles[b] = buckets_.triangles(b);
      if (finished[b] == 0 && build_.directory().isFinished(ingest::Stage::kPatchLeaves))
        return build_.directory().damaged();
    }

    // So many buckets are worked on at a time as memory holds.
    const std::vector<std::size_t> order = base::largestFirst(triangles);
    const std::uint64_t largest = order.empty() ? 1 : std::max<std::uint64_t>(1, triangles[order.front()]);
    const std::uint64_t at_once = std::max<std::uint64_t>(1, build_.workMemory() / (kBytesPerTriangle * largest));
    std::mutex mutex;
    const auto threads = static_cast<unsigned>(std::min<std::uint64_t>(build_.threads(), at_once));
    LUMIGRID_TRY(base::tryParallelFor(made.size(), threads, [&](std::size_t i) -> base::Result<void> {
      const std::size_t b = order[i];
      if (finished[b] != 0) return {};
      LUMIGRID_ASSIGN_OR_RETURN(auto bucket, makeLeaves(buckets_, b, build_.lattice(), options_, storedNormals()));
      // A unit of leaves has no group; its counts travel in the record's unused numbers.
      WorkUnit unit{0, static_cast<std::uint32_t>(b), {}};
      unit.group.first_patch = static_cast<std::uint32_t>(bucket.duplicates);
      unit.group.block_offset = bucket.vertices;
      LUMIGRID_ASSIGN_OR_RETURN(made[b], store_->add(unit, std::move(bucket.patches)));
      const std::lock_guard lock(mutex);
      note(unit);
      done += buckets_.triangles(b);
      const double share = static_cast<double>(done) / static_cast<double>(buckets_.totals().triangles);
      return build_.report("leaves", share) ? base::Result<void>() : build_.cancelled();
    }));
    // From here on the store alone holds the mesh.
    if (!build_.directory().isFinished(ingest::Stage::kPatchLeaves)) {
      LUMIGRID_TRY(build_.directory().finishStage(ingest::Stage::kPatchLeaves, {}, {"patches"},
                                                  [this] { build_.leaveBuckets(buckets_); }));
    }
    for (auto& patches : made)
      for (WorkPatch& patch : patches) leaves.push_back(std::move(patch));
    return {};
  }

  bool keepsTextures() const { return !options_.texture_path.empty(); }

  // Cuts the source's pictures up for the leaves, which get to know what detail their own colours lack.
  base::Result<void> makeTextures(std::vector<WorkPatch>& leaves) {
    if (!buckets_.hasTextures()) return {};
    LUMIGRID_ASSIGN_OR_RETURN(const auto places, ingest::TexturePlaces::open(build_.bucketDirectory()));
    LUMIGRID_ASSIGN_OR_RETURN(const auto units, ingest::PictureUnits::open(build_.sourceDirectory()));
    const LeafTextureSource source{build_.source().info.pictures, places, units, *store_, build_.lattice().lattice};
    const auto report = [this](double done) { return build_.report("textures", done); };
    const bool resume = build_.directory().has("pages");
    LUMIGRID_ASSIGN_OR_RETURN(textures_, LeafTextures::make(source, leaves, build_.directory().path(), resume,
                                                            {build_.threads(), build_.workMemory()}, report));
    for (std::size_t i = 0; i < leaves.size(); ++i) leaves[i].record.color_detail = textures_->colorDetail(i);
    return {};
  }

  base::Result<void> makeLevels(std::vector<WorkPatch> leaves) {
    for (const WorkPatch& leaf : leaves) summary_.triangles += leaf.record.triangles;
    // Groups keep two fifths of their triangles, pairs of the binary tree a half; `all` sums that over the levels. Some
    // groups keep more.
    constexpr double kNearlyDone = 0.99;  // as far as the estimate may show before the last group is built
    const double all = static_cast<double>(summary_.triangles) * (options_.regroup ? 5.0 / 3.0 : 2.0);
    std::uint64_t finished = 0;
    const auto advance = [&, this](std::uint64_t more) {
      finished += more;
      return build_.report("simplify", std::min(kNearlyDone, static_cast<double>(finished) / all));
    };
    LUMIGRID_ASSIGN_OR_RETURN(levels_, buildLevels(build_.lattice(), options_, storedNormals(), *store_,
                                                   std::move(leaves), std::move(known_), advance));
    return build_.report("simplify", 1.0) ? base::Result<void>() : build_.cancelled();
  }

  base::Result<void> write() {
    if (!build_.report("write", 0.0)) return build_.cancelled();
    Hierarchy hierarchy;
    hierarchy.lattice = build_.lattice().lattice;
    hierarchy.has_colors = buckets_.hasColors();
    hierarchy.source_triangles = summary_.triangles;
    const std::vector<WorkPatch>& patches = levels_.patches;
    const Numbering numbering(patches, levels_.groups);
    numbering.fill(hierarchy);
    const std::vector<std::uint32_t> order = numbering.patchOrder();
    std::vector<std::uint32_t> first;
    for (const Group& group : hierarchy.groups) first.push_back(group.first_patch);
    first.push_back(static_cast<std::uint32_t>(order.size()));
    if (textures_) LUMIGRID_TRY(writeTextures(order));
    return writePatchFile(build_.outputPath(), std::move(hierarchy),
                          [&](std::uint32_t group) -> base::Result<std::vector<base::Bytes>> {
                            std::vector<base::Bytes> block;
                            for (std::uint32_t p = first[group]; p < first[group + 1]; ++p) {
                              LUMIGRID_ASSIGN_OR_RETURN(auto bytes, bytesToWrite(patches[order[p]]));
                              block.push_back(std::move(bytes));
                            }
                            return block;
                          });
  }

  // The leaves are the first of the work patches.
  base::Result<void> writeTextures(std::span<const std::uint32_t> order) {
    std::vector<std::uint32_t> patch_of(order.size());
    for (std::uint32_t p = 0; p < order.size(); ++p) patch_of[order[p]] = p;
    LUMIGRID_ASSIGN_OR_RETURN(
        summary_.texture, textures_->write(options_.texture_path, patch_of, static_cast<std::uint32_t>(order.size()),
                                           options_.on_texture_bytes));
    return {};
  }

  // Returns what the levels above the leaves store.
  StoredNormals storedNormals() const {
    const bool is_scanned = buckets_.hasColors() && !build_.source().info.is_painted;
    return is_scanned ? options_.normals_beside_colors : options_.normals_without_colors;
  }

  // The levels were built with the normals of vertices, which tell the simplifier what bends.
  base::Result<base::Bytes> bytesToWrite(const WorkPatch& patch) const {
    LUMIGRID_ASSIGN_OR_RETURN(auto bytes, store_->encoded(patch));
    const StoredNormals normals = storedNormals();
    if (patch.record.level == 0 || normals == StoredNormals::kOfVertices) return bytes;
    const auto geometry = decodePatch(bytes);
    if (!geometry) return base::within("the builder's own file", geometry.error());
    return encodePatch(*geometry, nullptr, normals);
  }

  void fillSummary() {
    summary_.levels = levels_.levels;
    summary_.facing = buckets_.totals().facing;
    ingest::addRepairs(build_.source(), buckets_, build_.lattice(), summary_);
    summary_.repairs.add("duplicate_triangles", duplicates_);
    const std::uint64_t distinct =
        inner_vertices_ + buckets_.border().codes.size() + buckets_.totals().stitched.stitched_vertices;
    summary_.repairs.add("welded_vertices",
                         build_.source().info.referenced - std::min(build_.source().info.referenced, distinct));
    std::error_code ignored;
    summary_.bytes = std::filesystem::file_size(build_.outputPath(), ignored);
  }

  // Bytes per triangle of the source, measured on scans with colours.
  static constexpr std::uint64_t kOutputBytes = 12;
  static constexpr std::uint64_t kWorkBytes = 70;
  static constexpr double kTrianglesPerCoreSecond = 0.3e6;
  // Memory of a bucket while leaves are built of it, bytes per triangle, measured.
  static constexpr std::uint64_t kBytesPerTriangle = 420;

  HierarchyOptions options_;
  ingest::StagedBuild build_;
  ingest::Buckets buckets_;
  std::optional<WorkStore> store_;
  std::vector<std::pair<WorkUnit, std::vector<WorkPatch>>> known_;
  std::optional<LeafTextures> textures_;
  BuiltLevels levels_;
  std::uint64_t duplicates_ = 0;
  std::uint64_t inner_vertices_ = 0;
  HierarchySummary summary_;
};

}  // namespace

base::Result<HierarchySummary> buildHierarchyFromFiles(const std::vector<std::string>& paths,
                                                       const HierarchyOptions& options, const std::string& output_path,
                                                       const ingest::Progress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto input, ingest::sourceFromFiles(paths, progress, options.limits.threads));
  return ingest::buildFromSource(paths, input, [&](const ingest::SourceInput& source) {
    return HierarchyBuilder(options, output_path, progress).run(source);
  });
}

}  // namespace lod::patch::builder
