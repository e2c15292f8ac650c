#include "lod/build/leaves.h"

#include <algorithm>
#include <array>
#include <span>

#include "lod/build/code_map.h"
#include "lod/patch/codec.h"

namespace lod::build {
namespace {

using Triple = std::array<std::uint32_t, 3>;

// The corners from the smallest on, in their winding.
Triple turned(const std::uint32_t* c) {
  if (c[0] < c[1] && c[0] < c[2]) return {c[0], c[1], c[2]};
  return c[1] < c[2] ? Triple{c[1], c[2], c[0]} : Triple{c[2], c[0], c[1]};
}

// Whether two of a few triangles may be the same: a look at the sums of their corners, which mostly tells.
bool mayHoldDuplicates(const CodedMesh& mesh, std::span<const KeyedIndex> triangles) {
  constexpr std::size_t kFew = 8;
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

// Of triangles that are the same, wound alike, the first stays. They share a median code, so they lie together.
std::uint64_t dropDuplicates(const CodedMesh& mesh, std::vector<KeyedIndex>& sorted) {
  std::vector<std::pair<Triple, std::uint32_t>> same;
  std::vector<std::uint8_t> drop(sorted.size(), 0);
  std::uint64_t dropped = 0;
  for (std::size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    while (end < sorted.size() && sorted[end].key == sorted[begin].key) ++end;
    if (end - begin < 2 || !mayHoldDuplicates(mesh, std::span(sorted).subspan(begin, end - begin))) continue;
    same.clear();
    for (std::size_t i = begin; i < end; ++i)
      same.emplace_back(turned(&mesh.indices[3 * std::size_t{sorted[i].index}]), static_cast<std::uint32_t>(i));
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

}  // namespace

base::Result<BucketLeaves> makeLeaves(const Buckets& buckets, std::size_t bucket, const SourceLattice& lattice,
                                      const LeafOptions& options) {
  BucketLeaves out;
  if (buckets.triangles(bucket) == 0) return out;
  auto corners = buckets.read(bucket);
  if (!corners) return corners.error();

  // Triangles by voxels first: whatever looks at them or at their vertices later finds neighbours side by side.
  const std::size_t triangles = corners->size() / 3;
  std::vector<KeyedIndex> sorted(triangles);
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const Corner* c = &(*corners)[3 * std::size_t{t}];
    sorted[t] = {medianCode(c[0].code, c[1].code, c[2].code), t};
  }
  radixSort(sorted, 3 * lattice.bits);

  // Vertices by their codes, in the order of the triangles.
  CodedMesh mesh;
  mesh.indices.resize(corners->size());
  mesh.codes.reserve(corners->size() / 5);
  const auto sortedCorners = [&](std::size_t i) { return &(*corners)[3 * std::size_t{sorted[i].index}]; };
  {
    CodeMap map(corners->size() / 6);
    for (std::size_t i = 0; i < triangles; ++i) {
      __builtin_prefetch(sortedCorners(std::min(i + 2 * CodeMap::kAhead, triangles - 1)));
      const Corner* ahead = sortedCorners(std::min(i + CodeMap::kAhead / 3, triangles - 1));
      for (std::size_t k = 0; k < 3; ++k) map.expect(ahead[k].code);
      const Corner* c = sortedCorners(i);
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [v, is_new] = map.insert(c[k].code, static_cast<std::uint32_t>(mesh.codes.size()));
        if (is_new) mesh.codes.push_back(c[k].code);
        mesh.indices[3 * i + k] = v;
      }
    }
  }
  mesh.positions.reserve(mesh.codes.size());
  for (const std::uint64_t code : mesh.codes) mesh.positions.push_back(mortonPoint(code));
  std::vector<VertexSums> sums(mesh.codes.size());
  for (std::size_t i = 0; i < triangles; ++i) {
    __builtin_prefetch(sortedCorners(std::min(i + CodeMap::kAhead, triangles - 1)));
    const Corner* c = sortedCorners(i);
    const std::uint32_t* v = &mesh.indices[3 * i];
    const glm::i64vec3 face = latticeNormal(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]]);
    for (std::size_t k = 0; k < 3; ++k) sums[v[k]].add(face, c[k]);
  }
  for (std::uint32_t t = 0; t < triangles; ++t) sorted[t].index = t;
  *corners = std::vector<Corner>();

  // Border vertices take what all buckets together say of them.
  std::vector<std::uint8_t> outer(mesh.codes.size(), 0);
  const BorderVertices& border = buckets.border();
  mesh.normals.reserve(mesh.codes.size());
  if (buckets.hasColors()) mesh.colors.reserve(mesh.codes.size());
  for (std::size_t v = 0; v < mesh.codes.size(); ++v) {
    if (!border.codes.empty())
      if (const std::int64_t at = border.find(mesh.codes[v]); at >= 0) {
        outer[v] = 1;
        sums[v] = border.sums[static_cast<std::size_t>(at)];
      }
    mesh.normals.push_back(sums[v].unitNormal());
    if (buckets.hasColors()) mesh.colors.push_back(lod::patch::quantizedColor(sums[v].meanColor()));
  }
  sums = std::vector<VertexSums>();
  lod::patch::quantizeNormals(mesh.normals);
  out.vertices = mesh.codes.size();

  out.duplicates = dropDuplicates(mesh, sorted);
  const auto parts =
      splitTriangles(mesh, sorted, lattice.bits, options.voxel_triangles, options.leaf_triangles, TieWeight::kNormals);
  out.patches = makePatches(mesh, parts, outer, {}, lattice.lattice, 0);
  return out;
}

}  // namespace lod::build
