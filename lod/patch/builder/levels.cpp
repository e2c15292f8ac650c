#include "lod/patch/builder/levels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <optional>
#include <span>
#include <unordered_map>

#include "base/parallel.h"
#include "lod/ingest/border_vertices.h"
#include "lod/ingest/code_map.h"
#include "lod/patch/builder/coarse_positions.h"
#include "lod/patch/builder/distance_bound.h"
#include "lod/patch/builder/partition.h"
#include "lod/patch/builder/patch_split.h"
#include "lod/patch/builder/simplify.h"
#include "lod/patch/codec.h"

namespace lod::patch::builder {
namespace {

// A group keeps two fifths of its triangles. All levels together then have 1.67 times the source's triangles: halves
// would make 2 and cut finer, thirds 1.5 and be built faster; the cuts of two fifths are nearer to those of halves.
constexpr double kKeptShare = 0.4;
// From this many groups on it does not matter which are built last, so they are built in the order of the work files. A
// choice: with a hundred threads each still builds some five of them.
constexpr std::size_t kManyGroups = 500;
// Distances below this share of a group's error so far are not looked into, nor those below half a lattice step. A
// choice: a smaller share looks into more triangles for bounds that hardly shrink.
constexpr float kNegligible = 0.05F;
// Where there are no colours, light makes them: normals whose ends differ by 1 (60 degrees) by half of black to white.
constexpr float kShadingOfTurn = 0.5F;
// A group's output is split along voxels of about this share of a patch: fine enough for even parts, coarse enough that
// bisection costs little. The number is a choice between the two.
constexpr std::uint32_t kVoxelsPerPatch = 32;

// The distance from black to white, 255 √3, rounded up.
constexpr float kMaxColorError = 441.673F;

// Holds the merged triangles of a group, and the lattice point at which its coordinates start.
struct MergedGroup {
  GroupMesh mesh;
  glm::ivec3 corner{0};
};

std::uint64_t unitKey(const WorkUnit& unit) {
  return std::uint64_t{unit.level} << 32 | unit.index;
}

// The least float that is not below x.
float roundedUp(double x) {
  const auto f = static_cast<float>(x);
  return static_cast<double>(f) < x ? std::nextafter(f, std::numeric_limits<float>::max()) : f;
}

MergedGroup mergePatches(const std::vector<PatchGeometry>& patches, std::span<const std::uint64_t> locked) {
  std::size_t max_vertices = 0;
  std::size_t indices = 0;
  glm::ivec3 low(std::numeric_limits<int>::max());
  for (const auto& patch : patches) {
    max_vertices += patch.positions.size(), indices += patch.indices.size();
    for (const glm::ivec3& q : patch.positions) low = glm::min(low, q);
  }
  MergedGroup merged;
  GroupMesh& mesh = merged.mesh;
  const bool colored = !patches.empty() && !patches.front().colors.empty();
  merged.corner = low;
  mesh.indices.resize(indices);
  mesh.positions.resize(max_vertices);
  mesh.normals.resize(max_vertices);
  if (colored) mesh.colors.resize(max_vertices);
  ingest::CodeMap map(max_vertices);
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
      map.prefetch(codes[std::min(i + ingest::CodeMap::kPrefetchDistance, vertices - 1)]);
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

// Appends the bounds that a patch's triangles carry; leaves carry none.
base::Result<void> appendErrors(base::ByteView codes, std::size_t triangles, SurfaceError& errors) {
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

base::ByteView bytesOf(std::span<const std::uint16_t> codes) {
  return {reinterpret_cast<const std::uint8_t*>(codes.data()), codes.size_bytes()};
}

// The simplifier moves vertices to whole numbers, but does not know where the lattice ends.
void clampToLattice(MergedGroup& merged, std::uint32_t bits) {
  const glm::vec3 low(-merged.corner);
  const glm::vec3 high(glm::ivec3((1 << bits) - 1) - merged.corner);
  for (glm::vec3& p : merged.mesh.positions) p = glm::clamp(p, low, high);
}

// The normal of a vertex that collapses brought together from several, or that of the triangles around it where it fits
// none of these: on a flat side into which an edge was drawn, and on an edge, whose sides must show
// (docs/decisions/normals-of-facets.md).
glm::vec3 normalAmong(const ingest::FacetSums& facets, const glm::vec3& carried) {
  constexpr double kFlat = 0.985, kFits = 0.966;  // cosines of 10 and 15 degrees
  const glm::dvec3 mean = facets.mean();
  const double length = glm::length(mean);
  if (!(length > 0.0)) return carried;
  const double spread = glm::length(glm::dvec3(facets.by_angle)) / static_cast<double>(facets.angle);
  const bool is_off = spread > kFlat && glm::dot(mean, glm::dvec3(carried)) < kFits * length;
  return facets.isHard() || is_off ? glm::vec3(mean / length) : carried;
}

// Quantizes the group's vertices `source` as they will be stored; locked ones keep what is stored of them already.
void quantizeVertices(const MergedGroup& merged, std::span<const std::uint32_t> source,
                      std::span<const std::uint8_t> locked, StoredNormals normals, CodedMesh& out) {
  const GroupMesh& group = merged.mesh;
  const bool colored = !group.colors.empty();
  out.positions.resize(source.size());
  out.normals.resize(source.size());
  if (colored) out.colors.resize(source.size());
  for (std::size_t i = 0; i < source.size(); ++i)
    out.positions[i] = merged.corner + glm::ivec3(group.positions[source[i]]);
  const bool is_seen = normals == StoredNormals::kOfVertices;
  std::vector<ingest::FacetSums> facets(is_seen ? source.size() : 0);
  for (std::size_t c = 0; is_seen && c < out.indices.size(); c += 3) {
    const std::uint32_t* v = &out.indices[c];
    const auto facet = ingest::facetAtCorners(out.positions[v[0]], out.positions[v[1]], out.positions[v[2]]);
    for (std::size_t k = 0; k < 3; ++k) facets[v[k]] += facet[k];
  }
  for (std::size_t i = 0; i < source.size(); ++i) {
    const std::uint32_t v = source[i];
    const float length = glm::length(group.normals[v]);
    const glm::vec3 unit = length > 1e-6F ? group.normals[v] / length : glm::vec3(0.0F, 0.0F, 1.0F);
    out.normals[i] = locked[i] != 0 ? group.normals[v] : is_seen ? normalAmong(facets[i], unit) : unit;
    if (!colored) continue;
    if (locked[i] != 0)
      out.colors[i] = glm::u8vec4(glm::u8vec3(group.colors[v]), 255);
    else
      out.colors[i] =
          quantizedColor(glm::u8vec4(glm::u8vec3(glm::clamp(glm::round(group.colors[v]), 0.0F, 255.0F)), 255));
  }
  quantizeNormals(out.normals);
}

// The simplified triangles on lattice points. Vertices that came to lie on each other become one, and triangles that so
// lost their area are removed, from `history` too. `merged` gets the normals and colours that are stored.
CodedMesh codedMesh(MergedGroup& merged, CollapseHistory& history, StoredNormals normals,
                    std::vector<std::uint8_t>& locked) {
  GroupMesh& group = merged.mesh;
  CodedMesh out;
  ingest::CodeMap map(history.indices.size() / 5);
  std::vector<std::uint32_t> number(group.positions.size(), ingest::CodeMap::kNone);
  constexpr std::uint64_t kUnknown = std::numeric_limits<std::uint64_t>::max();
  std::vector<std::uint64_t> codes(group.positions.size(), kUnknown);
  out.indices.reserve(history.indices.size());
  std::vector<std::uint32_t> source;  // per vertex: the group's vertex that it comes from
  std::size_t kept = 0;
  for (std::size_t t = 0; 3 * t < history.indices.size(); ++t) {
    std::uint32_t c[3];
    std::uint64_t code[3];
    for (std::size_t k = 0; k < 3; ++k) {
      c[k] = history.indices[3 * t + k];
      std::uint64_t& known = codes[c[k]];
      if (known == kUnknown) known = ingest::mortonCode(merged.corner + glm::ivec3(group.positions[c[k]]));
      code[k] = known;
    }
    if (code[0] == code[1] || code[1] == code[2] || code[2] == code[0]) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t v = c[k];
      history.indices[3 * kept + k] = v;
      if (number[v] == ingest::CodeMap::kNone) {
        const auto [at, is_new] = map.insert(code[k]);
        number[v] = at;
        if (is_new) {
          source.push_back(v);
          locked.push_back(0);
        }
        // A locked vertex decides for all that lie there, since another group sees the same one.
        if (group.locked[v] != 0 && locked[at] == 0) {
          locked[at] = 1;
          source[at] = v;
        }
      }
      out.indices.push_back(number[v]);
    }
    history.origin[kept++] = history.origin[t];
  }
  out.codes = map.releaseCodes();
  quantizeVertices(merged, source, locked, normals, out);
  history.indices.resize(3 * kept);
  history.origin.resize(kept);
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == ingest::CodeMap::kNone) continue;
    group.normals[v] = out.normals[number[v]];
    if (!group.colors.empty()) group.colors[v] = glm::vec3(glm::u8vec3(out.colors[number[v]]));
  }
  return out;
}

// A simplified group, with its errors in lattice steps.
struct MeasuredGroup {
  CodedMesh mesh;                    // without triangles where all came to lie on lines
  std::vector<std::uint8_t> outer;   // per vertex: shared with another group
  std::vector<std::uint16_t> codes;  // kErrorCodes a triangle
  float error = 0.0F;                // the largest of all triangles
  float color_error = 0.0F;
  TypicalError typical;  // of this simplification alone
  double area = 0.0;     // of all triangles
};

float doubledArea(const CodedMesh& mesh, std::size_t t) {
  const auto corner = [&](std::size_t k) { return glm::vec3(mesh.positions[mesh.indices[3 * t + k]]); };
  const glm::vec3 a = corner(0);
  return glm::length(glm::cross(corner(1) - a, corner(2) - a));
}

MeasuredGroup measureGroup(const MergedGroup& before, FacetSurface& surface, const SurfaceError& before_error,
                           SimplifiedGroup& group, std::uint32_t bits, float negligible, StoredNormals normals) {
  MergedGroup merged{std::move(group.vertices), before.corner};
  merged.mesh.locked = before.mesh.locked;
  clampToLattice(merged, bits);
  MeasuredGroup out;
  out.mesh = codedMesh(merged, group.history, normals, out.outer);
  if (out.mesh.indices.empty()) return out;
  const SurfaceView after{merged.mesh.positions, group.history.indices, merged.mesh.colors,
                          surface.view().normals.empty() ? std::span<const glm::vec3>() : merged.mesh.normals};
  const SurfaceError error = carryError(surface, before_error, after, group.history, negligible, &out.typical);
  out.codes.resize(kErrorCodes * error.toward.size());
  for (std::size_t t = 0; t < error.toward.size(); ++t) {
    std::uint16_t* code = &out.codes[kErrorCodes * t];
    code[0] = errorCode(error.toward[t]);
    code[1] = errorCode(error.from[t]);
    code[2] = error.color.empty() ? std::uint16_t{0} : errorCode(error.color[t]);
    out.area += 0.5 * static_cast<double>(doubledArea(out.mesh, t));
    out.error = std::max({out.error, error.toward[t], error.from[t]});
    if (!error.color.empty()) out.color_error = std::max(out.color_error, error.color[t]);
  }
  out.error = errorOfCode(errorCode(out.error));
  out.color_error = errorOfCode(errorCode(out.color_error));
  return out;
}

class LevelBuilder {
 public:
  LevelBuilder(const ingest::SourceLattice& lattice, const HierarchyOptions& options, StoredNormals normals,
               WorkStore& store, std::vector<std::pair<WorkUnit, std::vector<WorkPatch>>> known,
               const std::function<bool(std::uint64_t)>& advance)
      : lattice_(lattice), options_(options), stored_normals_(normals), store_(store), advance_(advance) {
    for (auto& [unit, patches] : known)
      if (unit.level != 0) known_[unitKey(unit)] = {unit.group, std::move(patches)};
  }

  base::Result<BuiltLevels> buildLevels(std::vector<WorkPatch> leaves) {
    patches_ = std::move(leaves);
    std::vector<std::uint32_t> level(patches_.size());
    for (std::uint32_t p = 0; p < level.size(); ++p) level[p] = p;
    addLevelSummary(level);
    while (level.size() > 1 || patches_[level[0]].record.triangles > options_.node_triangles) {
      LUMIGRID_TRY(buildLevel(level));
      addLevelSummary(level);
      // Nothing can be simplified further.
      if (level.size() == 1 && levels_.back().triangles == levels_[levels_.size() - 2].triangles) break;
    }
    return BuiltLevels{std::move(patches_), std::move(groups_), std::move(levels_)};
  }

 private:
  struct GroupInput {
    std::vector<std::uint32_t> consumed;  // work numbers of patches
    std::vector<std::uint64_t> locked;    // codes of the vertices shared with other groups
  };
  struct BuiltGroup {
    Group record;
    std::vector<WorkPatch> produced;
  };
  struct SharedVertex {
    std::uint64_t code = 0;
    std::uint32_t patch = 0;  // place in the level
  };

  // The border vertices that several patches of the level use, with each of these patches, sorted by code.
  base::Result<std::vector<SharedVertex>> sharedVertices(std::span<const std::uint32_t> level) const {
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

  std::vector<std::uint32_t> groupOfPatches(std::span<const std::uint32_t> level, std::span<const SharedVertex> shared,
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

    // An edge weighs as many vertices as two patches share. Components that share nothing are tied to their neighbours
    // in Morton order.
    std::vector<WeightedEdge> edges;
    for (std::size_t begin = 0, end = 0; begin < shared.size(); begin = end) {
      while (end < shared.size() && shared[end].code == shared[begin].code) ++end;
      for (std::size_t i = begin; i < end; ++i)
        for (std::size_t j = i + 1; j < std::min(end, i + 8); ++j)
          edges.push_back({shared[i].patch, shared[j].patch, 1});
    }
    std::vector<ingest::KeyedIndex> places(level.size());
    for (std::uint32_t i = 0; i < level.size(); ++i) {
      const glm::dvec3 q =
          (glm::dvec3(patches_[level[i]].record.bounds.center) - lattice_.lattice.origin) / lattice_.lattice.step;
      places[i] = {ingest::mortonCode(glm::ivec3(glm::clamp(q, 0.0, static_cast<double>((1U << lattice_.bits) - 1)))),
                   i};
    }
    ingest::radixSort(places, 3 * lattice_.bits);
    std::vector<std::uint32_t> order;
    for (const ingest::KeyedIndex& place : places) order.push_back(place.index);
    tieComponents(order, edges);

    // METIS makes the groups; a patch left alone joins the group that it shares most with.
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

  base::Result<std::vector<GroupInput>> groupInputs(std::span<const std::uint32_t> level) const {
    LUMIGRID_ASSIGN_OR_RETURN(const std::vector<SharedVertex> shared, sharedVertices(level));
    std::uint32_t groups = 0;
    const std::vector<std::uint32_t> part = groupOfPatches(level, shared, groups);
    std::vector<GroupInput> inputs(groups);
    for (std::uint32_t i = 0; i < level.size(); ++i) inputs[part[i]].consumed.push_back(level[i]);
    // A vertex that groups share is locked in each of them.
    for (std::size_t begin = 0, end = 0; begin < shared.size(); begin = end) {
      bool several = false;
      for (end = begin; end < shared.size() && shared[end].code == shared[begin].code; ++end)
        several |= part[shared[end].patch] != part[shared[begin].patch];
      if (!several) continue;
      for (std::size_t i = begin; i < end; ++i)
        if (auto& list = inputs[part[shared[i].patch]].locked; list.empty() || list.back() != shared[i].code)
          list.push_back(shared[i].code);
    }
    return inputs;
  }

  base::Result<void> buildLevel(std::vector<std::uint32_t>& level) {
    const std::uint32_t number = patches_[level[0]].record.level + 1;
    LUMIGRID_ASSIGN_OR_RETURN(auto inputs, groupInputs(level));
    LUMIGRID_ASSIGN_OR_RETURN(auto built, buildGroups(number, inputs));

    level.clear();
    for (std::size_t g = 0; g < built.size(); ++g) {
      const auto group = static_cast<std::uint32_t>(groups_.size());
      WorkGroup work{built[g].record, std::move(inputs[g].consumed), {}};
      for (const std::uint32_t p : work.consumed) patches_[p].record.consumer = group;
      for (WorkPatch& patch : built[g].produced) {
        patch.record.producer = group;
        work.produced.push_back(static_cast<std::uint32_t>(patches_.size()));
        level.push_back(work.produced.back());
        patches_.push_back(std::move(patch));
      }
      groups_.push_back(std::move(work));
    }
    return {};
  }

  // Builds the groups independently of each other; the results are in the order of the inputs.
  base::Result<std::vector<BuiltGroup>> buildGroups(std::uint32_t level, std::span<const GroupInput> inputs) {
    std::vector<BuiltGroup> built(inputs.size());
    std::vector<std::uint64_t> triangles(inputs.size(), 0);
    for (std::size_t g = 0; g < inputs.size(); ++g)
      for (const std::uint32_t p : inputs[g].consumed) triangles[g] += patches_[p].record.triangles;
    const std::vector<std::size_t> order =
        inputs.size() < kManyGroups ? base::largestFirst(triangles) : std::vector<std::size_t>();
    LUMIGRID_TRY(forEachGroup(inputs.size(), [&](std::size_t i) -> base::Result<std::uint64_t> {
      const std::size_t g = order.empty() ? i : order[i];
      LUMIGRID_ASSIGN_OR_RETURN(built[g], buildGroup(inputs[g], {level, static_cast<std::uint32_t>(g), {}}));
      return triangles[g];
    }));
    return built;
  }

  base::Result<BuiltGroup> buildGroup(const GroupInput& input, WorkUnit unit) {
    // An earlier run may have built it.
    if (const auto at = known_.find(unitKey(unit)); at != known_.end()) return std::move(at->second);

    SurfaceError carried;
    LUMIGRID_ASSIGN_OR_RETURN(auto geometry, readGeometry(input, carried));
    const MergedGroup merged = mergePatches(geometry, input.locked);
    geometry.clear();
    Group& record = unit.group;
    record.level = unit.level;
    std::vector<base::Sphere> spheres = addErrorsBelow(input, record);

    // Simplify.
    const double step = lattice_.lattice.step;
    const auto below = static_cast<float>(static_cast<double>(record.error) / step);
    const float negligible = std::max(0.5F, kNegligible * below);
    thread_local FacetSurface surface;  // keeps its memory from group to group
    const bool is_shaded = merged.mesh.colors.empty();
    surface.reset({merged.mesh.positions, merged.mesh.indices, merged.mesh.colors,
                   is_shaded ? merged.mesh.normals : std::span<const glm::vec3>()});
    const std::size_t target =
        options_.regroup ? static_cast<std::size_t>(kKeptShare * static_cast<double>(merged.mesh.indices.size() / 3))
                         : options_.node_triangles;
    SimplifiedGroup simplified = simplifyGroup(merged.mesh, surface, target);
    coarsenPositions(simplified, merged.mesh.locked, merged.corner,
                     spareBits(std::sqrt(meanSquareBelow(input)) / step));
    MeasuredGroup made = measureGroup(merged, surface, carried, simplified, lattice_.bits, negligible, stored_normals_);
    if (made.mesh.indices.empty())
      return base::Error{
          base::ErrorCode::kInvalidInput,
          "the mesh has a part whose triangles all lie on lines; remove that part, or raise --position-bits"};
    record.error = std::max(record.error, errorRoundedUp(roundedUp(static_cast<double>(made.error) * step)));
    record.attribute_error =
        std::max(record.attribute_error, errorRoundedUp(std::min(1.0F, made.color_error / kMaxColorError)));
    addTypicalError(made, input, record);

    // Split into new patches.
    const std::vector<ingest::KeyedIndex> sorted = sortedByVoxel(made.mesh, lattice_.bits);
    const std::uint32_t max_triangles = options_.regroup ? options_.node_triangles : kMaxPatchVertices / 3;
    const auto parts = splitTriangles(made.mesh, sorted, lattice_.bits, max_triangles / kVoxelsPerPatch, max_triangles,
                                      TieWeight::kSharedVertices);
    std::vector<NewPatch> patches =
        makePatches(made.mesh, parts, made.outer, bytesOf(made.codes), lattice_.lattice, unit.level);
    for (const NewPatch& patch : patches) spheres.push_back(patch.record.bounds);
    record.bounds = base::boundingSphere(spheres);
    LUMIGRID_ASSIGN_OR_RETURN(auto stored, store_.add(unit, std::move(patches)));
    return BuiltGroup{record, std::move(stored)};
  }

  // The consumed patches' geometry, and the errors that their triangles carry.
  base::Result<std::vector<PatchGeometry>> readGeometry(const GroupInput& input, SurfaceError& carried) const {
    std::vector<PatchGeometry> geometry;
    base::Bytes bytes;
    for (const std::uint32_t p : input.consumed) {
      LUMIGRID_TRY(store_.readWhole(patches_[p], bytes));
      const base::ByteView encoded = base::ByteView(bytes).first(patches_[p].encoded_bytes);
      auto decoded = decodePatch(encoded);
      if (!decoded) return base::within("the builder's own file", decoded.error());
      // Leaves have no errors, whatever else they carry.
      const bool leaf = patches_[p].record.level == 0;
      const base::ByteView codes = leaf ? base::ByteView() : base::ByteView(bytes).subspan(encoded.size());
      LUMIGRID_TRY(appendErrors(codes, decoded->indices.size() / 3, carried));
      geometry.push_back(std::move(*decoded));
    }
    return geometry;
  }

  // Raises the record's errors to those of the groups below, so that errors are monotone. Returns the spheres that the
  // group's sphere has to contain.
  std::vector<base::Sphere> addErrorsBelow(const GroupInput& input, Group& record) const {
    std::vector<base::Sphere> spheres;
    for (const std::uint32_t p : input.consumed) {
      spheres.push_back(patches_[p].record.bounds);
      if (const std::uint32_t producer = patches_[p].record.producer; producer != kNoGroup) {
        const Group& below = groups_[producer].record;
        spheres.push_back(below.bounds);
        record.error = std::max(record.error, below.error);
        record.attribute_error = std::max(record.attribute_error, below.attribute_error);
      }
    }
    return spheres;
  }

  // The mean square of the typical errors of what the group merges, by triangles.
  double meanSquareBelow(const GroupInput& input) const {
    double triangles = 0.0, sum = 0.0;
    for (const std::uint32_t p : input.consumed) {
      const Patch& patch = patches_[p].record;
      triangles += patch.triangles;
      if (patch.producer == kNoGroup) continue;  // a leaf, which has none
      const auto error = static_cast<double>(groups_[patch.producer].record.typical_error);
      sum += patch.triangles * error * error;
    }
    return sum / triangles;
  }

  // States the group's typical errors, and from them the error that cuts go by. Steps of different levels are
  // independent of each other, so their squares are added; those of the groups below weigh as their triangles do. Cuts
  // need errors that no group below exceeds.
  void addTypicalError(const MeasuredGroup& made, const GroupInput& input, Group& record) const {
    const double step = lattice_.lattice.step;
    double triangles = 0.0, color2 = 0.0;
    float typical_below = 0.0F;
    float visible_below = 0.0F;
    for (const std::uint32_t p : input.consumed) {
      const Patch& patch = patches_[p].record;
      triangles += patch.triangles;
      if (patch.producer == kNoGroup) {
        // Leaves have the source's shape, but their colours may lack a texture's detail.
        const double detail = static_cast<double>(colorDetailOf(patch));
        color2 += patch.triangles * detail * detail;
        continue;
      }
      const Group& below = groups_[patch.producer].record;
      color2 += patch.triangles * static_cast<double>(below.typical_color_error) *
                static_cast<double>(below.typical_color_error);
      typical_below = std::max(typical_below, below.typical_error);
      visible_below = std::max(visible_below, below.visible_error);
    }
    const double own = step * static_cast<double>(made.typical.distance);
    const auto own_color =
        static_cast<double>(std::max(made.typical.color / kMaxColorError, kShadingOfTurn * made.typical.normal));
    const double distance2 = meanSquareBelow(input) + own * own;
    color2 = color2 / triangles + own_color * own_color;
    record.typical_error = std::max(typical_below, errorRounded(static_cast<float>(std::sqrt(distance2))));
    record.typical_color_error = errorRounded(static_cast<float>(std::min(1.0, std::sqrt(color2))));
    const double edge = step * std::sqrt(2.0 * made.area / static_cast<double>(made.mesh.indices.size() / 3));
    const double detail = static_cast<double>(kDetailLength) * edge * static_cast<double>(record.typical_color_error);
    const double visible = static_cast<double>(kVisibleRatio) * std::sqrt(distance2 + detail * detail);
    record.visible_error = std::max(visible_below, errorRounded(static_cast<float>(visible)));
  }

  // Calls build(0) … build(count - 1) in parallel until one fails. `build` returns the triangles that count as
  // progress, which is not reported again once it has cancelled the build.
  base::Result<void> forEachGroup(std::size_t count,
                                  const std::function<base::Result<std::uint64_t>(std::size_t)>& build) {
    std::mutex mutex;
    bool cancelled = false;
    return base::tryParallelFor(count, options_.limits.threads, [&](std::size_t i) -> base::Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(const auto triangles, build(i));
      const std::lock_guard lock(mutex);
      cancelled = cancelled || !advance_(triangles);
      if (!cancelled) return {};
      return base::Error{base::ErrorCode::kCancelled, "building the patch hierarchy was cancelled"};
    });
  }

  void addLevelSummary(std::span<const std::uint32_t> level) {
    LevelSummary summary;
    summary.patches = level.size();
    double squares = 0.0;
    for (const std::uint32_t p : level) {
      const Patch& patch = patches_[p].record;
      summary.triangles += patch.triangles;
      if (patch.producer == kNoGroup) continue;
      const Group& group = groups_[patch.producer].record;
      summary.max_error = std::max(summary.max_error, group.error);
      squares += patch.triangles * static_cast<double>(group.typical_error) * static_cast<double>(group.typical_error);
    }
    summary.typical_error = std::sqrt(squares / static_cast<double>(std::max<std::uint64_t>(1, summary.triangles)));
    levels_.push_back(summary);
  }

  const ingest::SourceLattice& lattice_;
  const HierarchyOptions& options_;
  StoredNormals stored_normals_;
  WorkStore& store_;
  const std::function<bool(std::uint64_t)>& advance_;
  std::vector<WorkPatch> patches_;
  std::vector<WorkGroup> groups_;
  std::vector<LevelSummary> levels_;
  std::unordered_map<std::uint64_t, BuiltGroup> known_;  // by level and index
};

}  // namespace

base::Result<BuiltLevels> buildLevels(const ingest::SourceLattice& lattice, const HierarchyOptions& options,
                                      StoredNormals normals, WorkStore& store, std::vector<WorkPatch> leaves,
                                      std::vector<std::pair<WorkUnit, std::vector<WorkPatch>>> known,
                                      const std::function<bool(std::uint64_t)>& advance) {
  return LevelBuilder(lattice, options, normals, store, std::move(known), advance).buildLevels(std::move(leaves));
}

}  // namespace lod::patch::builder
