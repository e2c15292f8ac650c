#include "lod/patch/builder/levels.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>

#include "base/parallel.h"
#include "lod/ingest/code_map.h"
#include "lod/patch/builder/distance_bound.h"
#include "lod/patch/builder/partition.h"
#include "lod/patch/builder/patch_split.h"
#include "lod/patch/builder/simplify.h"
#include "lod/patch/codec.h"

namespace lod::patch::builder {
namespace {

// A group keeps two fifths of its triangles. Halves cut finer, thirds are built faster and take less room: all levels
// together have 2 and 1.5 times the source's triangles. Two fifths make 1.67, and cuts nearer to halves'.
constexpr double kKept = 0.4;
// A group that stands out is made again so often with the same share of what may change, and with what was off by this
// share of its limit or more kept as it was; then with larger shares.
constexpr int kRounds = 3;
constexpr float kKeptAsTheyAre = 0.95F;
constexpr std::array<double, 3> kMoreKept{0.5, 0.6, 0.75};
// So many outliers are mostly none, where bounds are not precise.
constexpr std::ptrdiff_t kFewOutliers = 30;
constexpr float kNotPrecise = std::numeric_limits<float>::infinity();
// Of so many groups the last ones take next to nothing of the time: they are made as they lie in the work files.
constexpr std::size_t kManyGroups = 500;
// A level of one group has none that stands out.
constexpr std::size_t kMinGroups = 2;
// Distances below this share of a group's error so far do not matter.
constexpr float kNegligible = 0.05F;
// A group's output is split along voxels of about this share of a patch: fine enough for even parts, coarse enough that
// bisection costs little.
constexpr std::uint32_t kVoxelsPerPatch = 32;

// The length of a change from black to white.
constexpr float kLargestColor = 441.673F;

// The merged triangles of a group, and where its coordinates start.
struct Merged {
  GroupMesh mesh;
  glm::ivec3 corner{0};
};

std::uint64_t unitKey(std::uint32_t level, std::uint32_t index) {
  return std::uint64_t{level} << 32 | index;
}

// Not below x, whatever the conversion rounds.
float roundedUp(double x) {
  const auto f = static_cast<float>(x);
  return static_cast<double>(f) < x ? std::nextafter(f, std::numeric_limits<float>::max()) : f;
}

Merged mergePatches(const std::vector<lod::patch::PatchGeometry>& patches, std::span<const std::uint64_t> locked) {
  std::size_t most = 0;
  std::size_t indices = 0;
  glm::ivec3 low(std::numeric_limits<int>::max());
  for (const auto& patch : patches) {
    most += patch.positions.size(), indices += patch.indices.size();
    for (const glm::ivec3& q : patch.positions) low = glm::min(low, q);
  }
  Merged merged;
  GroupMesh& mesh = merged.mesh;
  const bool colored = !patches.empty() && !patches.front().colors.empty();
  merged.corner = low;
  mesh.indices.resize(indices);
  mesh.positions.resize(most);
  mesh.normals.resize(most);
  if (colored) mesh.colors.resize(most);
  ingest::CodeMap map(most);
  std::vector<std::uint32_t> local;
  std::vector<std::uint64_t> codes;
  std::uint32_t count = 0;
  std::uint32_t* corner = mesh.indices.data();
  for (const auto& patch : patches) {
    const std::size_t vertices = patch.positions.size();
    local.resize(vertices);
    codes.resize(vertices);
    for (std::size_t i = 0; i < vertices; ++i) codes[i] = ingest::mortonCode(patch.positions[i]);
    for (std::size_t i = 0; i < vertices; ++i) {
      map.prefetch(codes[std::min(i + ingest::CodeMap::kAhead, vertices - 1)]);
      const auto [number, is_new] = map.insert(codes[i]);
      local[i] = number;
      if (!is_new) continue;
      mesh.positions[count] = glm::vec3(patch.positions[i] - low);
      mesh.normals[count] = patch.normals[i];
      if (colored) mesh.colors[count] = glm::vec3(glm::u8vec3(patch.colors[i]));
      ++count;
    }
    for (const std::uint16_t index : patch.indices) *corner++ = local[index];
  }
  mesh.positions.resize(count);
  mesh.normals.resize(count);
  if (colored) mesh.colors.resize(count);
  mesh.locked.assign(count, 0);
  for (const std::uint64_t code : locked)
    if (const std::uint32_t v = map.at(code); v != ingest::CodeMap::kNone) mesh.locked[v] = 1;
  return merged;
}

// The bounds of a patch's triangles, behind those read before.
base::Result<void> addErrors(base::ByteView codes, std::size_t triangles, SurfaceError& errors) {
  if (!codes.empty() && codes.size() != kErrorBytes * triangles)
    return base::Error{base::ErrorCode::kInvalidInput, "the builder's own file: errors of another number of triangles"};
  const std::size_t first = errors.toward.size();
  for (std::vector<float>* v : {&errors.toward, &errors.from, &errors.color}) v->resize(first + triangles, 0.0F);
  for (std::size_t t = 0; !codes.empty() && t < triangles; ++t) {
    std::array<std::uint16_t, kErrorCodes> code{};
    std::memcpy(code.data(), &codes[kErrorBytes * t], kErrorBytes);
    errors.toward[first + t] = errorOfCode(code[0]);
    errors.from[first + t] = errorOfCode(code[1]);
    errors.color[first + t] = errorOfCode(code[2]);
  }
  return {};
}

// The simplifier moves vertices to whole numbers, but knows no end of the lattice.
void keepOnLattice(Merged& merged, std::uint32_t bits) {
  const glm::vec3 low(-merged.corner);
  const glm::vec3 high(glm::ivec3((1 << bits) - 1) - merged.corner);
  for (glm::vec3& p : merged.mesh.positions) p = glm::clamp(p, low, high);
}

// The group's vertices `source` as they will be stored; those locked stay as they are stored already.
void takeVertices(const Merged& merged, std::span<const std::uint32_t> source, std::span<const std::uint8_t> locked,
                  CodedMesh& out) {
  const GroupMesh& group = merged.mesh;
  const bool colored = !group.colors.empty();
  out.positions.resize(source.size());
  out.normals.resize(source.size());
  if (colored) out.colors.resize(source.size());
  for (std::size_t i = 0; i < source.size(); ++i) {
    const std::uint32_t v = source[i];
    out.positions[i] = merged.corner + glm::ivec3(group.positions[v]);
    const float length = glm::length(group.normals[v]);
    const glm::vec3 unit = length > 1e-6F ? group.normals[v] / length : glm::vec3(0.0F, 0.0F, 1.0F);
    out.normals[i] = locked[i] != 0 ? group.normals[v] : unit;
    if (!colored) continue;
    if (locked[i] != 0)
      out.colors[i] = glm::u8vec4(glm::u8vec3(group.colors[v]), 255);
    else
      out.colors[i] = lod::patch::quantizedColor(
          glm::u8vec4(glm::u8vec3(glm::clamp(glm::round(group.colors[v]), 0.0F, 255.0F)), 255));
  }
  lod::patch::quantizeNormals(out.normals);
}

// Simplified triangles on lattice points, and `merged` with the colours that they are stored with: vertices that came
// to lie on each other are one, and triangles that lost their area so are gone from the mesh and the history.
CodedMesh codedMesh(Merged& merged, CollapseHistory& simplified, std::vector<std::uint8_t>& locked) {
  GroupMesh& group = merged.mesh;
  CodedMesh out;
  ingest::CodeMap map(simplified.indices.size() / 5);
  std::vector<std::uint32_t> number(group.positions.size(), ingest::CodeMap::kNone);
  constexpr std::uint64_t kUnknown = std::numeric_limits<std::uint64_t>::max();
  std::vector<std::uint64_t> codes(group.positions.size(), kUnknown);
  out.indices.reserve(simplified.indices.size());
  std::vector<std::uint32_t> source;  // of each vertex: the group's that it is taken from
  std::size_t kept = 0;
  for (std::size_t t = 0; 3 * t < simplified.indices.size(); ++t) {
    std::uint32_t c[3];
    std::uint64_t code[3];
    for (std::size_t k = 0; k < 3; ++k) {
      c[k] = simplified.indices[3 * t + k];
      std::uint64_t& known = codes[c[k]];
      if (known == kUnknown) known = ingest::mortonCode(merged.corner + glm::ivec3(group.positions[c[k]]));
      code[k] = known;
    }
    if (code[0] == code[1] || code[1] == code[2] || code[2] == code[0]) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t v = c[k];
      simplified.indices[3 * kept + k] = v;
      if (number[v] == ingest::CodeMap::kNone) {
        const auto [at, is_new] = map.insert(code[k]);
        number[v] = at;
        if (is_new) {
          source.push_back(v);
          locked.push_back(0);
        }
        // What is locked decides for all that lie there: another group sees the same.
        if (group.locked[v] != 0 && locked[at] == 0) {
          locked[at] = 1;
          source[at] = v;
        }
      }
      out.indices.push_back(number[v]);
    }
    simplified.origin[kept++] = simplified.origin[t];
  }
  out.codes = map.releaseCodes();
  takeVertices(merged, source, locked, out);
  simplified.indices.resize(3 * kept);
  simplified.origin.resize(kept);
  const bool colored = !group.colors.empty();
  for (std::size_t v = 0; colored && v < number.size(); ++v)
    if (number[v] != ingest::CodeMap::kNone) group.colors[v] = glm::vec3(glm::u8vec3(out.colors[number[v]]));
  return out;
}

// A group's triangles when there are fewer, and how far they are off, in lattice steps.
struct Coarser {
  CodedMesh mesh;                    // without triangles where all came to lie on lines
  std::vector<std::uint8_t> outer;   // per vertex: shared with another group
  std::vector<std::uint16_t> codes;  // kErrorCodes a triangle
  ErrorHistogram errors;
  float error = 0.0F;  // the largest
  float color_error = 0.0F;
  std::vector<Outlier> outliers;
};

float doubledArea(const CodedMesh& mesh, std::size_t t) {
  const auto corner = [&](std::size_t k) { return glm::vec3(mesh.positions[mesh.indices[3 * t + k]]); };
  const glm::vec3 a = corner(0);
  return glm::length(glm::cross(corner(1) - a, corner(2) - a));
}

Coarser coarserOf(const Merged& before, FacetSurface& surface, const SurfaceError& before_error, SimplifiedGroup& group,
                  std::uint32_t bits, float negligible, float precise) {
  Merged merged{std::move(group.vertices), before.corner};
  merged.mesh.locked = before.mesh.locked;
  keepOnLattice(merged, bits);
  Coarser out;
  out.mesh = codedMesh(merged, group.history, out.outer);
  if (out.mesh.indices.empty()) return out;
  const SurfaceError error =
      carryError(surface, before_error, {merged.mesh.positions, group.history.indices, merged.mesh.colors},
                 group.history, negligible, out.outliers, precise);
  out.codes.resize(kErrorCodes * error.toward.size());
  for (std::size_t t = 0; t < error.toward.size(); ++t) {
    std::uint16_t* code = &out.codes[kErrorCodes * t];
    code[0] = errorCode(error.toward[t]);
    code[1] = errorCode(error.from[t]);
    code[2] = error.color.empty() ? std::uint16_t{0} : errorCode(error.color[t]);
    const float area = doubledArea(out.mesh, t);
    out.errors.add(code[0], area);
    out.errors.add(code[1], area);
    out.error = std::max({out.error, error.toward[t], error.from[t]});
    if (!error.color.empty()) out.color_error = std::max(out.color_error, error.color[t]);
  }
  out.error = errorOfCode(errorCode(out.error));
  out.color_error = errorOfCode(errorCode(out.color_error));
  return out;
}

// The share of a mesh's triangles that is left when those whose corners are all locked stay, and of the others the
// usual share does: were the others to pay for them, they would be off by more than before.
double shareAround(const GroupMesh& mesh) {
  std::size_t stay = 0;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3)
    stay += mesh.locked[mesh.indices[i]] & mesh.locked[mesh.indices[i + 1]] & mesh.locked[mesh.indices[i + 2]];
  return kKept + (1.0 - kKept) * static_cast<double>(3 * stay) / static_cast<double>(mesh.indices.size());
}

// Does it stay as it was when the group is to be off by at most `allowed`?
bool isFar(const Outlier& outlier, float allowed) {
  return outlier.error > kKeptAsTheyAre * allowed;
}

bool isAnyFar(const std::vector<Outlier>& outliers, float allowed) {
  return std::any_of(outliers.begin(), outliers.end(), [&](const Outlier& outlier) { return isFar(outlier, allowed); });
}

// Makes a group until it is off by at most `allowed`; else the best that was made, without triangles if none was.
// First each time with what was off by more kept as it was: mostly such places are few. `make` makes it of a mesh, with
// a share of its triangles; `outliers` are those of `mesh` with the usual share.
template <class Make>
Coarser keptWithin(float allowed, const GroupMesh& mesh, std::vector<Outlier> outliers, Make&& make) {
  Coarser best;
  const float far = kKeptAsTheyAre * allowed;
  const auto isWithin = [&] { return !best.mesh.indices.empty() && best.error <= allowed; };
  // Levels end only where groups shrink.
  const double most = kMoreKept.back() * static_cast<double>(mesh.indices.size());
  const auto take = [&](Coarser next) {
    outliers = next.outliers;
    const std::size_t indices = next.mesh.indices.size();
    if (indices == 0 || static_cast<double>(indices) > most) return;
    if (best.mesh.indices.empty() || next.error < best.error) best = std::move(next);
  };
  const auto count =
      std::count_if(outliers.begin(), outliers.end(), [&](const Outlier& outlier) { return isFar(outlier, allowed); });
  if (count > kFewOutliers) take(make(mesh, kKept, far));
  if (!isAnyFar(outliers, allowed)) return best;
  GroupMesh kept = mesh;
  for (int round = 0; round < kRounds && !isWithin(); ++round) {
    bool is_new = false;
    for (const Outlier& outlier : outliers)
      for (std::size_t k = 0; k < 3 && isFar(outlier, allowed); ++k) {
        std::uint8_t& locked = kept.locked[mesh.indices[3 * std::size_t{outlier.triangle} + k]];
        is_new |= locked == 0;
        locked = 1;
      }
    if (!is_new) break;
    take(make(kept, shareAround(kept), far));
  }
  for (auto share = kMoreKept.begin(); share != kMoreKept.end() && !isWithin(); ++share)
    take(make(mesh, *share, kNotPrecise));
  return best;
}

// What no group of a level should be off by, in lattice steps, when `errors` are those of all: stated bounds are to be
// at most four times the 99.9th percentile of true distances. That percentile is about 0.4 of the 90th of the bounds,
// which are sums, and more on the lower levels, which add up less; there it also rises with how far the 99th is from
// the 90th. At the first level nothing is added up, and the 90th may be that of planes that were simplified for nothing
// (docs/results/hierarchy.md, "Stated errors").
float usualLimit(const ErrorHistogram& errors, std::uint32_t level) {
  const float usual = errors.quantile(0.9);
  if (level == 1) return std::max(4.0F, std::min(12.0F * usual, 1.9F * errors.quantile(0.999)));
  const auto l = static_cast<float>(level);
  const float high = errors.quantile(0.99);
  const float by_usual = (1.1F + 4.2F / (l * std::sqrt(l))) * usual;
  const float by_high = 1.2F * high + 8.0F / (l * l) * (high - usual);
  return std::max(4.0F, std::min(by_usual, by_high));
}

}  // namespace

LevelBuilder::LevelBuilder(const ingest::SourceLattice& lattice, const HierarchyOptions& options, WorkStore& store,
                           std::function<bool(std::uint64_t)> advance)
    : lattice_(lattice), options_(options), store_(store), advance_(std::move(advance)) {}

void LevelBuilder::know(const WorkUnit& unit, std::vector<WorkPatch> patches) {
  known_[unitKey(unit.level, unit.index)] = {unit.group, unit.errors, std::move(patches), std::nullopt};
}

base::Result<void> LevelBuilder::makeLevels(std::vector<WorkPatch> leaves) {
  patches_ = std::move(leaves);
  std::vector<std::uint32_t> level(patches_.size());
  for (std::uint32_t p = 0; p < level.size(); ++p) level[p] = p;
  addLevelSummary(level);
  while (level.size() > 1 || patches_[level[0]].record.triangles > options_.node_triangles) {
    LUMIGRID_TRY(makeLevel(level));
    addLevelSummary(level);
    // Nothing that can be simplified further.
    if (level.size() == 1 && levels_.back().triangles == levels_[levels_.size() - 2].triangles) break;
  }
  return {};
}

// Border vertices that several patches of the level use, with each of them, by code.
base::Result<std::vector<LevelBuilder::SharedVertex>> LevelBuilder::sharedVertices(
    std::span<const std::uint32_t> level) const {
  std::vector<ingest::KeyedIndex> uses;
  std::size_t count = 0;
  for (const std::uint32_t p : level) count += patches_[p].border_codes;
  uses.reserve(count);
  std::vector<std::uint64_t> codes;
  for (std::uint32_t i = 0; i < level.size(); ++i) {
    LUMIGRID_TRY(store_.readBorder(patches_[level[i]], codes));
    for (const std::uint64_t code : codes) uses.push_back({code, i});
  }
  ingest::radixSort(uses, 3 * lattice_.bits);
  std::vector<SharedVertex> shared;
  for (std::size_t begin = 0, end = 0; begin < uses.size(); begin = end) {
    while (end < uses.size() && uses[end].key == uses[begin].key) ++end;
    if (end - begin < 2) continue;
    for (std::size_t i = begin; i < end; ++i) shared.push_back({uses[i].key, uses[i].index});
  }
  return shared;
}

std::vector<std::uint32_t> LevelBuilder::groupOfPatches(std::span<const std::uint32_t> level,
                                                        std::span<const SharedVertex> shared,
                                                        std::uint32_t& groups) const {
  groups = 1;
  if (!options_.regroup) {
    // The paper's binary tree: siblings lie side by side.
    groups = static_cast<std::uint32_t>((level.size() + 1) / 2);
    std::vector<std::uint32_t> part(level.size());
    for (std::uint32_t i = 0; i < part.size(); ++i) part[i] = i / 2;
    return part;
  }
  if (level.size() <= options_.group_patches + 1) return std::vector<std::uint32_t>(level.size(), 0);

  // Edges: shared vertices, each pair at a vertex once; where nothing is shared, neighbours in Morton order.
  std::vector<WeightedEdge> edges;
  for (std::size_t begin = 0, end = 0; begin < shared.size(); begin = end) {
    while (end < shared.size() && shared[end].code == shared[begin].code) ++end;
    for (std::size_t i = begin; i < end; ++i)
      for (std::size_t j = i + 1; j < std::min(end, i + 8); ++j) edges.push_back({shared[i].patch, shared[j].patch, 1});
  }
  std::vector<ingest::KeyedIndex> places(level.size());
  for (std::uint32_t i = 0; i < level.size(); ++i) {
    const glm::dvec3 q =
        (glm::dvec3(patches_[level[i]].record.bounds.center) - lattice_.lattice.origin) / lattice_.lattice.step;
    places[i] = {ingest::mortonCode(glm::ivec3(glm::clamp(q, 0.0, static_cast<double>((1U << lattice_.bits) - 1)))), i};
  }
  ingest::radixSort(places, 3 * lattice_.bits);
  std::vector<std::uint32_t> order;
  for (const ingest::KeyedIndex& place : places) order.push_back(place.index);
  tieComponents(order, edges);

  // METIS; a patch left alone joins the group it shares most with.
  std::vector<std::int32_t> weights;
  for (const std::uint32_t p : level) weights.push_back(static_cast<std::int32_t>(patches_[p].record.triangles));
  const Graph graph = graphFromEdges(std::move(weights), std::move(edges));
  const auto parts = static_cast<std::uint32_t>((level.size() + options_.group_patches / 2) / options_.group_patches);
  std::vector<std::uint32_t> part = partitionIntoParts(graph, parts);
  std::vector<std::uint32_t> size(parts, 0);
  for (const std::uint32_t p : part) ++size[p];
  for (std::uint32_t i = 0; i < level.size(); ++i) {
    if (size[part[i]] != 1) continue;
    std::size_t best = ingest::CodeMap::kNone;
    for (auto e = static_cast<std::size_t>(graph.row[i]); e < static_cast<std::size_t>(graph.row[i + 1]); ++e)
      if (best == ingest::CodeMap::kNone || graph.edge_weights[e] > graph.edge_weights[best]) best = e;
    if (best == ingest::CodeMap::kNone) continue;
    --size[part[i]];
    part[i] = part[static_cast<std::size_t>(graph.neighbors[best])];
    ++size[part[i]];
  }
  // Numbers without gaps.
  std::vector<std::uint32_t> number(parts, 0);
  groups = 0;
  for (std::uint32_t p = 0; p < parts; ++p) number[p] = size[p] > 0 ? groups++ : 0;
  for (std::uint32_t& p : part) p = number[p];
  return part;
}

// The level's patches in groups.
base::Result<std::vector<LevelBuilder::Piece>> LevelBuilder::piecesOf(std::span<const std::uint32_t> level) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto read, sharedVertices(level));
  const std::vector<SharedVertex>& shared = read;
  std::uint32_t groups = 0;
  const std::vector<std::uint32_t> part = groupOfPatches(level, shared, groups);
  std::vector<Piece> pieces(groups);
  for (std::uint32_t i = 0; i < level.size(); ++i) pieces[part[i]].consumed.push_back(level[i]);
  // Shared between groups: locked in each of them.
  for (std::size_t begin = 0, end = 0; begin < shared.size(); begin = end) {
    bool several = false;
    for (end = begin; end < shared.size() && shared[end].code == shared[begin].code; ++end)
      several |= part[shared[end].patch] != part[shared[begin].patch];
    if (!several) continue;
    for (std::size_t i = begin; i < end; ++i)
      if (auto& list = pieces[part[shared[i].patch]].locked; list.empty() || list.back() != shared[i].code)
        list.push_back(shared[i].code);
  }
  return pieces;
}

base::Result<void> LevelBuilder::makeLevel(std::vector<std::uint32_t>& level) {
  const std::uint32_t number = patches_[level[0]].record.level + 1;
  LUMIGRID_ASSIGN_OR_RETURN(auto pieces, piecesOf(level));
  LUMIGRID_ASSIGN_OR_RETURN(auto made, makeGroups(number, pieces));
  if (options_.regroup && pieces.size() >= kMinGroups) LUMIGRID_TRY(makeAgain(number, pieces, made));

  level.clear();
  for (std::size_t g = 0; g < made.size(); ++g) {
    const auto group = static_cast<std::uint32_t>(groups_.size());
    WorkGroup work{made[g].record, std::move(pieces[g].consumed), {}};
    for (const std::uint32_t p : work.consumed) patches_[p].record.consumer = group;
    for (WorkPatch& patch : made[g].produced) {
      patch.record.producer = group;
      work.produced.push_back(static_cast<std::uint32_t>(patches_.size()));
      level.push_back(work.produced.back());
      patches_.push_back(std::move(patch));
    }
    groups_.push_back(std::move(work));
  }
  return {};
}

// `make` in parallel for 0 … count - 1, until one fails; it returns how much work that was.
base::Result<void> LevelBuilder::forEachPiece(std::size_t count,
                                              const std::function<base::Result<std::uint64_t>(std::size_t)>& make) {
  std::mutex mutex;
  std::atomic<bool> stopped = false;
  base::Result<void> status;
  base::parallelFor(count, options_.limits.threads, [&](std::size_t i) {
    if (stopped) return;
    const base::Result<std::uint64_t> triangles = make(i);
    const std::lock_guard lock(mutex);
    if (stopped) return;
    if (!triangles)
      status = triangles.error(), stopped = true;
    else if (!advance_(*triangles))
      status = base::Error{base::ErrorCode::kCancelled, "building the patch hierarchy was cancelled"}, stopped = true;
  });
  return status;
}

// The groups, each on its own; their results in order.
base::Result<std::vector<LevelBuilder::Made>> LevelBuilder::makeGroups(std::uint32_t level,
                                                                       std::span<const Piece> pieces) {
  std::vector<Made> made(pieces.size());
  std::vector<std::uint64_t> triangles(pieces.size(), 0);
  for (std::size_t g = 0; g < pieces.size(); ++g)
    for (const std::uint32_t p : pieces[g].consumed) triangles[g] += patches_[p].record.triangles;
  const std::vector<std::size_t> order =
      pieces.size() < kManyGroups ? base::largestFirst(triangles) : std::vector<std::size_t>();
  LUMIGRID_TRY(forEachPiece(pieces.size(), [&](std::size_t i) -> base::Result<std::uint64_t> {
    const std::size_t g = order.empty() ? i : order[i];
    LUMIGRID_ASSIGN_OR_RETURN(auto&& result,
                              knownOrMade(pieces[g], {level, static_cast<std::uint32_t>(g), {}, {}}, nullptr));
    made[g] = std::move(result);
    return triangles[g];
  }));
  return made;
}

// Groups whose bound stands out, once more; the better one counts.
base::Result<void> LevelBuilder::makeAgain(std::uint32_t level, std::span<const Piece> pieces,
                                           std::vector<Made>& made) {
  ErrorHistogram errors;
  for (const Made& group : made) errors.add(group.errors);
  const float allowed = usualLimit(errors, level);
  const auto limit = static_cast<float>(static_cast<double>(allowed) * lattice_.lattice.step);
  std::vector<std::size_t> out;
  for (std::size_t g = 0; g < made.size(); ++g)
    // Some are off by what they took over from the level below: that stays.
    if (made[g].record.error > limit && (!made[g].outliers || isAnyFar(*made[g].outliers, allowed))) out.push_back(g);
  return forEachPiece(out.size(), [&](std::size_t i) -> base::Result<std::uint64_t> {
    const std::size_t g = out[i];
    const Again again{allowed, std::move(made[g].outliers)};
    LUMIGRID_ASSIGN_OR_RETURN(
        auto&& result, knownOrMade(pieces[g], {level, static_cast<std::uint32_t>(pieces.size() + g), {}, {}}, &again));
    if (result.record.error < made[g].record.error) made[g] = std::move(result);
    return 0;
  });
}

base::Result<LevelBuilder::Made> LevelBuilder::knownOrMade(const Piece& piece, WorkUnit unit, const Again* again) {
  if (const auto at = known_.find(unitKey(unit.level, unit.index)); at != known_.end()) return std::move(at->second);
  return makeGroup(piece, std::move(unit), again);
}

base::Result<LevelBuilder::Made> LevelBuilder::makeGroup(const Piece& piece, WorkUnit unit, const Again* again) {
  // Merge.
  std::vector<lod::patch::PatchGeometry> geometry;
  SurfaceError before_error;
  base::Bytes bytes;
  for (const std::uint32_t p : piece.consumed) {
    LUMIGRID_TRY(store_.readWhole(patches_[p], bytes));
    const base::ByteView encoded = base::ByteView(bytes).first(patches_[p].encoded_bytes);
    auto decoded = lod::patch::decodePatch(encoded);
    if (!decoded) return base::within("the builder's own file", decoded.error());
    const base::ByteView codes = base::ByteView(bytes).subspan(encoded.size());
    LUMIGRID_TRY(addErrors(codes, decoded->indices.size() / 3, before_error));
    geometry.push_back(std::move(*decoded));
  }
  const Merged merged = mergePatches(geometry, piece.locked);
  geometry.clear();

  // What it cost so far, all levels together: never less than below.
  lod::patch::Group& record = unit.group;
  record.level = unit.level;
  std::vector<base::Sphere> spheres;
  for (const std::uint32_t p : piece.consumed) {
    spheres.push_back(patches_[p].record.bounds);
    if (const std::uint32_t producer = patches_[p].record.producer; producer != lod::patch::kNoGroup) {
      const lod::patch::Group& below = groups_[producer].record;
      spheres.push_back(below.bounds);
      record.error = std::max(record.error, below.error);
      record.attribute_error = std::max(record.attribute_error, below.attribute_error);
    }
  }
  const double step = lattice_.lattice.step;
  const auto below = static_cast<float>(static_cast<double>(record.error) / step);
  const float negligible = std::max(0.5F, kNegligible * below);

  // Simplify.
  thread_local FacetSurface surface;  // whose memory is kept
  surface.reset({merged.mesh.positions, merged.mesh.indices, merged.mesh.colors});
  const auto make = [&](const GroupMesh& mesh, double share, float precise) {
    const std::size_t target = options_.regroup
                                   ? static_cast<std::size_t>(share * static_cast<double>(mesh.indices.size() / 3))
                                   : options_.node_triangles;
    SimplifiedGroup simplified = simplifyGroup(mesh, surface, target);
    return coarserOf(merged, surface, before_error, simplified, lattice_.bits, negligible, precise);
  };
  Coarser best;
  if (again == nullptr || !again->outliers) best = make(merged.mesh, kKept, kNotPrecise);
  if (again != nullptr) {
    best = keptWithin(again->allowed, merged.mesh, again->outliers ? *again->outliers : best.outliers, make);
    if (best.mesh.indices.empty()) best = make(merged.mesh, kKept, kNotPrecise);
  }
  if (best.mesh.indices.empty())
    return base::Error{
        base::ErrorCode::kInvalidInput,
        "the mesh has a part whose triangles all lie on lines; remove that part, or raise --position-bits"};
  record.error = std::max(record.error, roundedUp(static_cast<double>(best.error) * step));
  record.attribute_error = std::max(record.attribute_error, std::min(1.0F, best.color_error / kLargestColor));
  unit.errors = std::move(best.errors);

  // Split into new patches.
  const std::vector<ingest::KeyedIndex> sorted = sortedByVoxel(best.mesh, lattice_.bits);
  const std::uint32_t most = options_.regroup ? options_.node_triangles : lod::patch::kMaxPatchVertices / 3;
  std::vector<NewPatch> patches = makePatches(
      best.mesh,
      splitTriangles(best.mesh, sorted, lattice_.bits, most / kVoxelsPerPatch, most, TieWeight::kSharedVertices),
      best.outer, best.codes, lattice_.lattice, unit.level);
  for (const NewPatch& patch : patches) spheres.push_back(patch.record.bounds);
  record.bounds = base::boundingSphere(spheres);
  LUMIGRID_ASSIGN_OR_RETURN(auto stored, store_.add(unit, std::move(patches)));
  return Made{record, std::move(unit.errors), std::move(stored), std::move(best.outliers)};
}

void LevelBuilder::addLevelSummary(std::span<const std::uint32_t> level) {
  LevelSummary summary;
  summary.patches = level.size();
  for (const std::uint32_t p : level) {
    summary.triangles += patches_[p].record.triangles;
    if (const std::uint32_t g = patches_[p].record.producer; g != lod::patch::kNoGroup)
      summary.max_error = std::max(summary.max_error, groups_[g].record.error);
  }
  levels_.push_back(summary);
}

}  // namespace lod::patch::builder
