#include "lod/patch/builder/leaves.h"

#include <algorithm>
#include <array>
#include <span>

#include "lod/ingest/code_map.h"
#include "lod/patch/codec.h"

namespace lod::patch::builder {
namespace {

constexpr std::size_t kPrefetchDistance =
    24;  // triangles are requested so far ahead, since they lie anywhere in memory

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

}  // namespace

base::Result<BucketLeaves> makeLeaves(const ingest::Buckets& buckets, std::size_t bucket,
                                      const ingest::SourceLattice& lattice, const HierarchyOptions& options) {
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
  // For a mesh without colours and normals only the facets' normals are summed, which takes less memory traffic.
  const bool attributes = buckets.hasColors() || buckets.hasNormals();
  std::vector<ingest::VertexSums> sums(attributes ? vertices : 0);
  std::vector<glm::i64vec3> faces(attributes ? 0 : vertices, glm::i64vec3(0));
  for (std::size_t i = 0; i < triangles; ++i) {
    const std::uint32_t* v = &mesh.indices[3 * i];
    const glm::i64vec3 face = ingest::latticeNormal(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]]);
    if (!attributes) {
      for (std::size_t k = 0; k < 3; ++k) faces[v[k]] += face;
      continue;
    }
    __builtin_prefetch(&read.corners[3 * std::size_t{sorted[std::min(i + kPrefetchDistance, triangles - 1)].index}]);
    for (std::size_t k = 0; k < 3; ++k) sums[v[k]].add(face, read.corners[3 * std::size_t{sorted[i].index} + k]);
  }
  for (std::uint32_t t = 0; t < triangles; ++t) sorted[t].index = t;
  read = {};

  // Border vertices get the sums of all buckets.
  std::vector<std::uint8_t> outer(vertices, 0);
  const ingest::BorderVertices& border = buckets.border();
  mesh.normals.reserve(vertices);
  if (buckets.hasColors()) mesh.colors.reserve(vertices);
  for (std::size_t v = 0; v < vertices; ++v) {
    ingest::VertexSums sum = attributes ? sums[v] : ingest::VertexSums{faces[v]};
    if (const std::int64_t at = border.find(mesh.codes[v]); at >= 0) {
      outer[v] = 1;
      sum = border.sums[static_cast<std::size_t>(at)];
    }
    mesh.normals.push_back(sum.unitNormal());
    if (buckets.hasColors()) mesh.colors.push_back(quantizedColor(sum.meanColor()));
  }
  sums = std::vector<ingest::VertexSums>();
  faces = std::vector<glm::i64vec3>();
  quantizeNormals(mesh.normals);
  out.vertices = mesh.codes.size();

  out.duplicates = dropDuplicates(mesh, sorted);
  const auto parts =
      splitTriangles(mesh, sorted, lattice.bits, options.voxel_triangles, options.leaf_triangles, TieWeight::kNormals);
  out.patches = makePatches(mesh, parts, outer, {}, lattice.lattice, 0);
  return out;
}

}  // namespace lod::patch::builder
