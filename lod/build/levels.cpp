#include "lod/build/levels.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>

#include "base/parallel.h"
#include "lod/build/distance_bound.h"
#include "lod/build/partition.h"
#include "lod/build/simplify.h"
#include "lod/patch/codec.h"

namespace lod::build {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
// A group's output is split along voxels of about this share of a patch: fine enough for even parts, coarse enough that
// METIS costs little.
constexpr float kNegligible = 0.05F;
constexpr std::uint32_t kVoxelsPerPatch = 32;

// The merged triangles of a group, with the lattice numbers of its vertices and where its coordinates start.
struct Merged {
  GroupMesh mesh;
  std::vector<std::uint32_t> vertices;
  glm::ivec3 corner{0};
};

// Open-addressed map from vertex number to position in the group.
class VertexMap {
 public:
  explicit VertexMap(std::size_t most) {
    std::size_t slots = 16;
    while (slots < 2 * most) slots *= 2;
    keys_.assign(slots, kNone);
    values_.resize(slots);
    mask_ = slots - 1;
  }
  // The value of `key`; `next` becomes its value when it is new.
  std::pair<std::uint32_t, bool> insert(std::uint32_t key, std::uint32_t next) {
    for (std::size_t slot = (key * 0x9E3779B1U) & mask_;; slot = (slot + 1) & mask_) {
      if (keys_[slot] == key) return {values_[slot], false};
      if (keys_[slot] != kNone) continue;
      keys_[slot] = key;
      values_[slot] = next;
      return {next, true};
    }
  }

 private:
  std::vector<std::uint32_t> keys_;
  std::vector<std::uint32_t> values_;
  std::size_t mask_ = 0;
};

Merged mergePatches(const std::vector<WorkPatch>& patches, std::span<const std::uint32_t> consumed) {
  std::size_t most = 0;
  std::size_t indices = 0;
  for (const std::uint32_t p : consumed) most += patches[p].vertices.size(), indices += patches[p].indices.size();
  Merged merged;
  merged.vertices.reserve(most);
  merged.mesh.indices.reserve(indices);
  VertexMap map(most);
  std::vector<std::uint32_t> local;
  for (const std::uint32_t p : consumed) {
    local.clear();
    for (const std::uint32_t v : patches[p].vertices) {
      const auto [number, is_new] = map.insert(v, static_cast<std::uint32_t>(merged.vertices.size()));
      if (is_new) merged.vertices.push_back(v);
      local.push_back(number);
    }
    for (const std::uint16_t i : patches[p].indices) merged.mesh.indices.push_back(local[i]);
  }
  return merged;
}

void takeVertices(const LatticeMesh& mesh, std::span<const std::uint8_t> locked, Merged& merged) {
  merged.corner = mesh.positions[merged.vertices[0]];
  for (const std::uint32_t v : merged.vertices) merged.corner = glm::min(merged.corner, mesh.positions[v]);
  GroupMesh& group = merged.mesh;
  for (const std::uint32_t v : merged.vertices) {
    group.positions.push_back(glm::vec3(mesh.positions[v] - merged.corner));
    group.normals.push_back(mesh.normals[v]);
    if (!mesh.colors.empty()) group.colors.push_back(glm::vec3(glm::u8vec3(mesh.colors[v])));
    group.locked.push_back(locked[v]);
  }
}

// Surviving vertices back to the shared arrays, as they will be stored. Locked ones are the same still.
void giveVertices(const Merged& merged, std::span<const std::uint32_t> survivor, std::uint32_t bits,
                  LatticeMesh& mesh) {
  const glm::ivec3 last((1 << bits) - 1);
  const GroupMesh& group = merged.mesh;
  for (std::uint32_t i = 0; i < merged.vertices.size(); ++i) {
    if (survivor[i] != i || group.locked[i] != 0) continue;
    const std::uint32_t v = merged.vertices[i];
    mesh.positions[v] = glm::clamp(merged.corner + glm::ivec3(glm::round(group.positions[i])), glm::ivec3(0), last);
    const float length = glm::length(group.normals[i]);
    if (length > 1e-6F) mesh.normals[v] = lod::patch::quantizedNormal(group.normals[i] / length);
    if (!mesh.colors.empty())
      mesh.colors[v] = glm::u8vec4(glm::u8vec3(glm::clamp(glm::round(group.colors[i]), 0.0F, 255.0F)), 255);
  }
}

// The part of each triangle: voxels, their graph, METIS; a voxel too large for one part is split by the order of its
// triangles.
std::vector<std::vector<std::uint32_t>> splitTriangles(const TriangleView& view, std::span<const KeyedIndex> sorted,
                                                       std::uint32_t bits, std::uint32_t voxel_triangles,
                                                       std::uint32_t max_triangles, TieWeight weight) {
  const std::vector<Voxel> voxels = makeVoxels(sorted, bits, std::max(1U, voxel_triangles));
  const Graph graph = voxelGraph(view, sorted, voxels, bits, weight);
  const std::vector<std::uint32_t> part = partitionRecursively(graph, max_triangles);
  std::vector<std::vector<std::uint32_t>> parts(part.empty() ? 0 : *std::max_element(part.begin(), part.end()) + 1);
  for (std::size_t v = 0; v < voxels.size(); ++v)
    for (std::uint32_t i = voxels[v].first; i < voxels[v].first + voxels[v].count; ++i)
      parts[part[v]].push_back(sorted[i].index);

  for (std::size_t p = 0; p < parts.size(); ++p) {
    if (parts[p].size() <= max_triangles) continue;
    std::vector<std::uint32_t> rest(parts[p].begin() + max_triangles, parts[p].end());
    parts[p].resize(max_triangles);
    parts.push_back(std::move(rest));
  }
  return parts;
}

// A patch of some triangles. `number_of` gives a vertex's lattice number; `local` is scratch, kNone everywhere before
// and after.
WorkPatch patchOf(std::span<const std::uint32_t> triangles, std::span<const std::uint32_t> indices,
                  std::span<const std::uint32_t> number_of, std::vector<std::uint32_t>& local) {
  WorkPatch patch;
  patch.indices.reserve(3 * triangles.size());
  std::vector<std::uint32_t> used;
  for (const std::uint32_t t : triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t v = indices[3 * std::size_t{t} + k];
      if (local[v] == kNone) local[v] = static_cast<std::uint32_t>(used.size()), used.push_back(v);
      patch.indices.push_back(static_cast<std::uint16_t>(local[v]));
    }
  }
  for (const std::uint32_t v : used) {
    local[v] = kNone;
    patch.vertices.push_back(number_of.empty() ? v : number_of[v]);
  }
  return patch;
}

std::vector<KeyedIndex> sortedByVoxel(std::span<const glm::ivec3> positions, std::span<const std::uint32_t> indices,
                                      std::uint32_t bits) {
  std::vector<std::uint64_t> codes(positions.size());
  for (std::size_t v = 0; v < positions.size(); ++v) codes[v] = mortonCode(positions[v]);
  std::vector<KeyedIndex> sorted(indices.size() / 3);
  for (std::uint32_t t = 0; t < sorted.size(); ++t) {
    const std::uint32_t* c = &indices[3 * std::size_t{t}];
    sorted[t] = {medianCode(codes[c[0]], codes[c[1]], codes[c[2]]), t};
  }
  radixSort(sorted, 3 * bits);
  return sorted;
}

// Not below x, whatever the conversion rounds.
float roundedUp(double x) {
  const auto f = static_cast<float>(x);
  return static_cast<double>(f) < x ? std::nextafter(f, std::numeric_limits<float>::max()) : f;
}

}  // namespace

LevelBuilder::LevelBuilder(LatticeMesh& mesh, const HierarchyOptions& options, KeepAs keep_as,
                           std::function<bool(std::uint64_t)> advance)
    : mesh_(mesh), options_(options), keep_as_(keep_as), advance_(std::move(advance)) {
  locked_.assign(mesh.positions.size(), 0);
  vertex_owner_.assign(mesh.positions.size(), kNone);
}

void LevelBuilder::makeLeaves() {
  const auto parts = splitTriangles(mesh_.view(), mesh_.sorted, mesh_.bits, options_.voxel_triangles,
                                    options_.leaf_triangles, TieWeight::kNormals);
  for (const auto& part : parts) patches_.push_back(patchOf(part, mesh_.indices, {}, vertex_owner_));
  mesh_.sorted = {};
  mesh_.indices = {};
  base::parallelFor(patches_.size(), options_.threads, [&](std::size_t p) { finishPatch(patches_[p], 0); });
}

bool LevelBuilder::makeLevels() {
  std::vector<std::uint32_t> level(patches_.size());
  for (std::uint32_t p = 0; p < level.size(); ++p) level[p] = p;
  addLevelSummary(level);
  while (level.size() > 1 || patches_[level[0]].record.triangles > options_.node_triangles) {
    if (!makeLevel(level)) return false;
    addLevelSummary(level);
  }
  return true;
}

bool LevelBuilder::makeLevel(std::vector<std::uint32_t>& level) {
  const std::vector<std::vector<std::uint32_t>> consumed = groupPatches(level);
  lockSharedVertices(consumed);

  // The groups, each on its own; their results in order.
  const std::uint32_t number = patches_[level[0]].record.level + 1;
  std::vector<GroupResult> results(consumed.size());
  std::mutex mutex;
  std::atomic<bool> cancelled = false;
  base::parallelFor(consumed.size(), options_.threads, [&](std::size_t g) {
    if (cancelled) return;
    results[g] = makeGroup(consumed[g], number);
    std::uint64_t triangles = 0;
    for (const std::uint32_t p : consumed[g]) triangles += patches_[p].record.triangles;
    const std::lock_guard lock(mutex);
    if (!advance_(triangles)) cancelled = true;
  });
  if (cancelled) return false;

  level.clear();
  for (GroupResult& result : results) {
    const auto group = static_cast<std::uint32_t>(groups_.size());
    for (const std::uint32_t p : result.group.consumed) {
      patches_[p].record.consumer = group;
      patches_[p].vertices = {};
      patches_[p].indices = {};
    }
    for (WorkPatch& patch : result.produced) {
      patch.record.producer = group;
      result.group.produced.push_back(static_cast<std::uint32_t>(patches_.size()));
      level.push_back(result.group.produced.back());
      patches_.push_back(std::move(patch));
    }
    groups_.push_back(std::move(result.group));
  }
  return true;
}

std::vector<std::vector<std::uint32_t>> LevelBuilder::groupPatches(std::span<const std::uint32_t> level) {
  if (level.size() <= options_.group_patches + 1) return {{level.begin(), level.end()}};

  // Vertices used by several patches, with each of them.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> shared;
  constexpr std::uint32_t kListed = 0x80000000U;
  for (std::uint32_t i = 0; i < level.size(); ++i) {
    for (const std::uint32_t v : patches_[level[i]].vertices) {
      std::uint32_t& owner = vertex_owner_[v];
      if (owner == kNone) {
        owner = i;
        continue;
      }
      if ((owner & kListed) == 0) shared.emplace_back(v, owner);
      owner |= kListed;
      shared.emplace_back(v, i);
    }
  }
  for (const std::uint32_t p : level)
    for (const std::uint32_t v : patches_[p].vertices) vertex_owner_[v] = kNone;
  std::sort(shared.begin(), shared.end());

  // Edges: shared vertices, each pair at a vertex once; where nothing is shared, neighbours in Morton order.
  std::vector<WeightedEdge> edges;
  for (std::size_t begin = 0, end = 0; begin < shared.size(); begin = end) {
    while (end < shared.size() && shared[end].first == shared[begin].first) ++end;
    for (std::size_t i = begin; i < end; ++i)
      for (std::size_t j = i + 1; j < std::min(end, i + 8); ++j)
        edges.push_back({shared[i].second, shared[j].second, 1});
  }
  std::vector<KeyedIndex> places(level.size());
  for (std::uint32_t i = 0; i < level.size(); ++i) {
    const glm::dvec3 q =
        (glm::dvec3(patches_[level[i]].record.bounds.center) - mesh_.lattice.origin) / mesh_.lattice.step;
    places[i] = {mortonCode(glm::ivec3(glm::clamp(q, 0.0, static_cast<double>((1U << mesh_.bits) - 1)))), i};
  }
  radixSort(places, 3 * mesh_.bits);
  std::vector<std::uint32_t> order;
  for (const KeyedIndex& place : places) order.push_back(place.index);
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
    std::size_t best = kNone;
    for (auto e = static_cast<std::size_t>(graph.row[i]); e < static_cast<std::size_t>(graph.row[i + 1]); ++e)
      if (best == kNone || graph.edge_weights[e] > graph.edge_weights[best]) best = e;
    if (best == kNone) continue;
    --size[part[i]];
    part[i] = part[static_cast<std::size_t>(graph.neighbors[best])];
    ++size[part[i]];
  }
  std::vector<std::vector<std::uint32_t>> groups(parts);
  for (std::uint32_t i = 0; i < level.size(); ++i) groups[part[i]].push_back(level[i]);
  std::erase_if(groups, [](const auto& g) { return g.empty(); });
  return groups;
}

void LevelBuilder::lockSharedVertices(const std::vector<std::vector<std::uint32_t>>& groups) {
  auto forEachVertex = [&](auto&& body) {
    for (std::uint32_t g = 0; g < groups.size(); ++g)
      for (const std::uint32_t p : groups[g])
        for (const std::uint32_t v : patches_[p].vertices) body(g, v);
  };
  forEachVertex([&](std::uint32_t, std::uint32_t v) { locked_[v] = 0; });
  forEachVertex([&](std::uint32_t g, std::uint32_t v) {
    if (vertex_owner_[v] == kNone) vertex_owner_[v] = g;
    if (vertex_owner_[v] != g) locked_[v] = 1;
  });
  forEachVertex([&](std::uint32_t, std::uint32_t v) { vertex_owner_[v] = kNone; });
}

LevelBuilder::GroupResult LevelBuilder::makeGroup(const std::vector<std::uint32_t>& consumed, std::uint32_t level) {
  // Merge and simplify to half.
  Merged merged = mergePatches(patches_, consumed);
  takeVertices(mesh_, locked_, merged);
  const std::vector<glm::vec3> before = merged.mesh.positions;
  const std::vector<std::uint32_t> before_indices = merged.mesh.indices;
  const Simplified simplified = simplifyGroup(merged.mesh, before_indices.size() / 6);
  giveVertices(merged, simplified.survivor, mesh_.bits, mesh_);

  // What it cost. Errors add up along the levels, by the triangle inequality.
  GroupResult result;
  result.group.consumed = consumed;
  result.group.record.level = level;
  std::vector<base::Sphere> spheres;
  for (const std::uint32_t p : consumed) {
    spheres.push_back(patches_[p].record.bounds);
    if (const std::uint32_t producer = patches_[p].record.producer; producer != lod::patch::kNoGroup) {
      const lod::patch::Group& below = groups_[producer].record;
      spheres.push_back(below.bounds);
      result.group.record.error = std::max(result.group.record.error, below.error);
      result.group.record.attribute_error = std::max(result.group.record.attribute_error, below.attribute_error);
    }
  }
  // Below half a lattice step, or a small part of what the levels below cost already, the distance does not matter.
  const auto below = static_cast<float>(static_cast<double>(result.group.record.error) / mesh_.lattice.step);
  const float h = distanceBound({before, before_indices}, {merged.mesh.positions, simplified.indices}, simplified,
                                std::max(0.5F, kNegligible * below));
  result.group.record.error =
      roundedUp(static_cast<double>(result.group.record.error) + static_cast<double>(h) * mesh_.lattice.step);
  result.group.record.attribute_error =
      std::min(1.0F, result.group.record.attribute_error + simplified.color_deviation);

  // Split into new patches.
  std::vector<glm::ivec3> positions(merged.vertices.size());
  for (std::size_t i = 0; i < positions.size(); ++i) positions[i] = mesh_.positions[merged.vertices[i]];
  const std::vector<KeyedIndex> sorted = sortedByVoxel(positions, simplified.indices, mesh_.bits);
  std::vector<std::uint32_t> local(positions.size(), kNone);
  for (const auto& part :
       splitTriangles({positions, simplified.indices}, sorted, mesh_.bits, options_.node_triangles / kVoxelsPerPatch,
                      options_.node_triangles, TieWeight::kSharedVertices)) {
    result.produced.push_back(patchOf(part, simplified.indices, merged.vertices, local));
    finishPatch(result.produced.back(), level);
    spheres.push_back(result.produced.back().record.bounds);
  }
  result.group.record.bounds = base::boundingSphere(spheres);
  return result;
}

void LevelBuilder::finishPatch(WorkPatch& patch, std::uint32_t level) const {
  // The geometry as it will be drawn.
  lod::patch::PatchGeometry geometry;
  std::vector<glm::vec3> points;
  for (const std::uint32_t v : patch.vertices) {
    geometry.positions.push_back(mesh_.positions[v]);
    geometry.normals.push_back(mesh_.normals[v]);
    if (!mesh_.colors.empty()) geometry.colors.push_back(mesh_.colors[v]);
    points.push_back(mesh_.lattice.position(mesh_.positions[v]));
  }
  geometry.indices = patch.indices;

  // Box, sphere and cone of it.
  lod::patch::Patch& record = patch.record;
  for (const glm::vec3& p : points) record.box.add(p);
  record.bounds = base::boundingSphere(points);
  std::vector<glm::vec3> normals;
  for (std::size_t i = 0; i < patch.indices.size(); i += 3) {
    const glm::vec3& a = points[patch.indices[i]];
    const glm::vec3 n = glm::cross(points[patch.indices[i + 1]] - a, points[patch.indices[i + 2]] - a);
    if (const float length = glm::length(n); length > 0.0F) normals.push_back(n / length);
  }
  record.cone = base::boundingCone(normals);
  record.level = level;
  record.triangles = static_cast<std::uint32_t>(patch.indices.size() / 3);
  record.vertices = static_cast<std::uint32_t>(patch.vertices.size());

  if (keep_as_ == KeepAs::kBytes)
    patch.bytes = lod::patch::encodePatch(geometry);
  else
    patch.geometry = std::move(geometry);
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

}  // namespace lod::build
