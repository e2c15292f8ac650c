#include "lod/patch/builder/voxels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace lod::patch::builder {
namespace {

// Adds the voxels of the triangles begin … end − 1, which all lie in one cell of 2^size_bits steps.
void addVoxels(std::span<const ingest::KeyedIndex> sorted, std::size_t begin, std::size_t end, std::uint32_t size_bits,
               std::uint32_t max_triangles, std::vector<Voxel>& voxels) {
  if (begin == end) return;
  if (end - begin <= max_triangles || size_bits == 0) {
    const std::uint64_t code = sorted[begin].key >> (3 * size_bits) << (3 * size_bits);
    voxels.push_back({code, size_bits, static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end - begin)});
    return;
  }
  const std::uint32_t shift = 3 * (size_bits - 1);
  while (begin < end) {
    const std::uint64_t child = sorted[begin].key >> shift;
    const auto next = std::partition_point(sorted.begin() + static_cast<std::ptrdiff_t>(begin),
                                           sorted.begin() + static_cast<std::ptrdiff_t>(end),
                                           [&](const ingest::KeyedIndex& k) { return k.key >> shift == child; });
    const auto middle = static_cast<std::size_t>(next - sorted.begin());
    addVoxels(sorted, begin, middle, size_bits - 1, max_triangles, voxels);
    begin = middle;
  }
}

constexpr std::uint32_t kNoVoxel = std::numeric_limits<std::uint32_t>::max();
// Triangles are requested so far ahead, since they lie anywhere in memory.
constexpr std::size_t kVoxelPrefetchDistance = 16;

// The voxel whose cell contains a lattice point, or kNoVoxel where no triangle is.
std::uint32_t voxelAt(std::span<const Voxel> voxels, std::uint64_t code) {
  // Finds the last voxel that begins at or before it. No branch could predict which way the search goes.
  const Voxel* voxel = voxels.data();
  for (std::size_t left = voxels.size(); left > 1;) {
    const std::size_t half = left / 2;
    voxel += voxel[half].code <= code ? half : 0;
    left -= half;
  }
  if (code >> (3 * voxel->size_bits) != voxel->code >> (3 * voxel->size_bits)) return kNoVoxel;
  return static_cast<std::uint32_t>(voxel - voxels.data());
}

// Every pair of voxels whose cells share a face, once: each voxel looks for neighbours of at least its own size.
std::vector<WeightedEdge> faceAdjacency(std::span<const Voxel> voxels, std::uint32_t bits) {
  std::vector<WeightedEdge> edges;
  const std::int32_t limit = std::int32_t{1} << bits;
  for (std::uint32_t v = 0; v < voxels.size(); ++v) {
    const glm::ivec3 corner = ingest::mortonPoint(voxels[v].code);
    const std::int32_t size = std::int32_t{1} << voxels[v].size_bits;
    for (int direction = 0; direction < 6; ++direction) {
      glm::ivec3 beyond = corner;
      beyond[direction / 2] += direction % 2 == 0 ? -size : size;
      if (beyond[direction / 2] < 0 || beyond[direction / 2] >= limit) continue;
      const std::uint32_t other = voxelAt(voxels, ingest::mortonCode(beyond));
      if (other == kNoVoxel || voxels[other].size_bits < voxels[v].size_bits) continue;
      if (voxels[other].size_bits > voxels[v].size_bits || v < other) edges.push_back({v, other, 1});
    }
  }
  return edges;
}

// Edges between the first voxel that uses a mesh vertex and the others that do, of weight 1 for each use. Their sum is
// about the length of the seam between two voxels.
std::vector<WeightedEdge> meshAdjacency(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                                        std::span<const Voxel> voxels) {
  std::vector<WeightedEdge> edges;
  std::vector<std::uint32_t> first_voxel(triangles.positions.size(), kNoVoxel);
  // Uses are summed voxel by voxel: `uses` counts for each other voxel, and `met` lists those that count.
  std::vector<std::int32_t> uses(voxels.size(), 0);
  std::vector<std::uint32_t> met(voxels.size() + 1);
  for (std::uint32_t v = 0; v < voxels.size(); ++v) {
    std::size_t others = 0;
    std::uint32_t last = v;
    for (std::uint32_t i = voxels[v].first; i < voxels[v].first + voxels[v].count; ++i) {
      __builtin_prefetch(
          &triangles.indices[3 * std::size_t{sorted[std::min(i + kVoxelPrefetchDistance, sorted.size() - 1)].index}]);
      for (std::size_t k = 0; k < 3; ++k) {
        std::uint32_t& first = first_voxel[triangles.indices[3 * std::size_t{sorted[i].index} + k]];
        const std::uint32_t other = std::min(first, v);  // voxels come in rising order
        first = other;
        if (static_cast<int>(other == v) | static_cast<int>(other == last)) continue;
        last = other;
        met[others] = other;
        others += uses[other]++ == 0 ? 1 : 0;
      }
    }
    for (std::size_t i = 0; i < others; ++i) edges.push_back({met[i], v, std::exchange(uses[met[i]], 0)});
  }
  return edges;
}

std::vector<glm::vec3> meanNormals(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                                   std::span<const Voxel> voxels) {
  std::vector<glm::vec3> normals(voxels.size());
  for (std::size_t v = 0; v < voxels.size(); ++v) {
    glm::dvec3 sum(0.0);
    for (std::uint32_t i = voxels[v].first; i < voxels[v].first + voxels[v].count; ++i) {
      const std::uint32_t* corner = &triangles.indices[3 * std::size_t{sorted[i].index}];
      const glm::dvec3 a(triangles.positions[corner[0]]);
      sum += glm::cross(glm::dvec3(triangles.positions[corner[1]]) - a, glm::dvec3(triangles.positions[corner[2]]) - a);
    }
    const double length = glm::length(sum);
    normals[v] = length > 0.0 ? glm::vec3(sum / length) : glm::vec3(0.0F);
  }
  return normals;
}

// The paper's weight, the inner product, mapped to 1 … 16, since METIS takes positive integers. Surfaces that face away
// from each other weigh 1 for touching.
std::int32_t normalWeight(const glm::vec3& a, const glm::vec3& b) {
  return 1 + static_cast<std::int32_t>(std::lround(15.0F * std::max(0.0F, glm::dot(a, b))));
}

}  // namespace

std::vector<Voxel> makeVoxels(std::span<const ingest::KeyedIndex> sorted, std::uint32_t bits,
                              std::uint32_t max_triangles) {
  std::vector<Voxel> voxels;
  addVoxels(sorted, 0, sorted.size(), bits, max_triangles, voxels);
  return voxels;
}

std::vector<Extent> voxelExtents(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                                 std::span<const Voxel> voxels) {
  std::vector<Extent> extents(voxels.size());
  for (std::size_t v = 0; v < voxels.size(); ++v) {
    glm::ivec3 low(std::numeric_limits<int>::max());
    glm::ivec3 high(std::numeric_limits<int>::min());
    for (std::uint32_t i = voxels[v].first; i < voxels[v].first + voxels[v].count; ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        const glm::ivec3& q = triangles.positions[triangles.indices[3 * std::size_t{sorted[i].index} + k]];
        low = glm::min(low, q);
        high = glm::max(high, q);
      }
    extents[v] = {glm::dvec3(low), glm::dvec3(high)};
  }
  return extents;
}

Graph voxelGraph(const TriangleView& triangles, std::span<const ingest::KeyedIndex> sorted,
                 std::span<const Voxel> voxels, std::uint32_t bits, TieWeight weight) {
  // Voxels are tied over their faces and by the mesh. With normals as weights, the number of shared vertices is
  // dropped.
  std::vector<WeightedEdge> edges = faceAdjacency(voxels, bits);
  const std::vector<WeightedEdge> mesh_edges = meshAdjacency(triangles, sorted, voxels);
  edges.insert(edges.end(), mesh_edges.begin(), mesh_edges.end());

  std::vector<std::int32_t> counts(voxels.size());
  for (std::size_t v = 0; v < voxels.size(); ++v) counts[v] = static_cast<std::int32_t>(voxels[v].count);
  Graph graph = graphFromEdges(std::move(counts), std::move(edges));
  if (weight == TieWeight::kSharedVertices) return graph;

  const std::vector<glm::vec3> normals = meanNormals(triangles, sorted, voxels);
  for (std::size_t v = 0; v < voxels.size(); ++v)
    for (auto e = static_cast<std::size_t>(graph.row[v]); e < static_cast<std::size_t>(graph.row[v + 1]); ++e)
      graph.edge_weights[e] = normalWeight(normals[v], normals[static_cast<std::size_t>(graph.neighbors[e])]);
  return graph;
}

}  // namespace lod::patch::builder
