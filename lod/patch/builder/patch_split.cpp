#include "lod/patch/builder/patch_split.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>

#include "lod/patch/builder/partition.h"
#include "lod/patch/codec.h"

namespace lod::patch::builder {
namespace {

constexpr std::uint32_t kNobody = std::numeric_limits<std::uint32_t>::max();

template <class T>
void gather(const std::vector<T>& from, std::span<const std::uint32_t> places, std::vector<T>& to) {
  to.resize(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) to[i] = from[places[i]];
}

// Fills in box, sphere and cone of the geometry as it will be drawn, and its counts.
void describe(const PatchGeometry& geometry, const Lattice& lattice, Patch& record) {
  std::vector<glm::vec3> points(geometry.positions.size());
  for (std::size_t v = 0; v < points.size(); ++v) points[v] = lattice.position(geometry.positions[v]);
  for (const glm::vec3& p : points) record.box.add(p);
  record.bounds = base::boundingSphere(points);
  std::vector<glm::vec3> normals;
  normals.reserve(geometry.indices.size() / 3);
  for (std::size_t i = 0; i < geometry.indices.size(); i += 3) {
    const glm::vec3& a = points[geometry.indices[i]];
    const glm::vec3 n = glm::cross(points[geometry.indices[i + 1]] - a, points[geometry.indices[i + 2]] - a);
    if (const float length = glm::length(n); length > 0.0F) normals.push_back(n / length);
  }
  record.cone = base::boundingCone(normals);
  record.triangles = static_cast<std::uint32_t>(geometry.indices.size() / 3);
  record.vertices = static_cast<std::uint32_t>(geometry.positions.size());
}

}  // namespace

std::vector<ingest::KeyedIndex> sortedByVoxel(const CodedMesh& mesh, std::uint32_t bits) {
  std::vector<ingest::KeyedIndex> sorted(mesh.indices.size() / 3);
  for (std::uint32_t t = 0; t < sorted.size(); ++t) {
    const std::uint32_t* c = &mesh.indices[3 * std::size_t{t}];
    sorted[t] = {ingest::medianCode(mesh.codes[c[0]], mesh.codes[c[1]], mesh.codes[c[2]]), t};
  }
  ingest::radixSort(sorted, 3 * bits);
  return sorted;
}

std::vector<std::vector<std::uint32_t>> splitTriangles(const CodedMesh& mesh,
                                                       std::span<const ingest::KeyedIndex> sorted, std::uint32_t bits,
                                                       std::uint32_t voxel_triangles, std::uint32_t max_triangles,
                                                       TieWeight weight) {
  std::vector<std::vector<std::uint32_t>> parts;
  if (sorted.size() <= max_triangles) {
    parts.emplace_back();
    for (const ingest::KeyedIndex& k : sorted) parts.back().push_back(k.index);
    return parts;
  }
  const std::vector<Voxel> voxels = makeVoxels(sorted, bits, std::max(1U, voxel_triangles));
  const Graph graph = voxelGraph(mesh.view(), sorted, voxels, bits, weight);
  const std::vector<std::uint32_t> part =
      partitionRecursively(graph, max_triangles, voxelExtents(mesh.view(), sorted, voxels));
  parts.resize(part.empty() ? 0 : *std::max_element(part.begin(), part.end()) + 1);
  for (std::size_t v = 0; v < voxels.size(); ++v)
    for (std::uint32_t i = voxels[v].first; i < voxels[v].first + voxels[v].count; ++i)
      parts[part[v]].push_back(sorted[i].index);

  // A voxel too large for one part is split by the order of its triangles.
  for (std::size_t p = 0; p < parts.size(); ++p) {
    if (parts[p].size() <= max_triangles) continue;
    std::vector<std::uint32_t> rest(parts[p].begin() + max_triangles, parts[p].end());
    parts[p].resize(max_triangles);
    parts.push_back(std::move(rest));
  }
  return parts;
}

std::vector<NewPatch> makePatches(const CodedMesh& mesh, const std::vector<std::vector<std::uint32_t>>& parts,
                                  std::span<const std::uint8_t> outer, base::ByteView carried, const Lattice& lattice,
                                  std::uint32_t level) {
  // Vertices that several parts use are border.
  std::vector<std::uint8_t> border(outer.begin(), outer.end());
  std::vector<std::uint32_t> owner(mesh.positions.size(), kNobody);
  // The corners of the parts' triangles, one part after the other.
  const auto corners = std::make_unique_for_overwrite<std::uint32_t[]>(mesh.indices.size());
  // Triangles are requested so far ahead, since they lie anywhere in memory.
  constexpr std::size_t kPrefetchDistance = 16;
  std::size_t next = 0;
  for (std::uint32_t p = 0; p < parts.size(); ++p)
    for (std::size_t i = 0; i < parts[p].size(); ++i) {
      __builtin_prefetch(
          &mesh.indices[3 * std::size_t{parts[p][std::min(i + kPrefetchDistance, parts[p].size() - 1)]}]);
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t v = mesh.indices[3 * std::size_t{parts[p][i]} + k];
        corners[next++] = v;
        border[v] |= static_cast<std::uint8_t>((owner[v] != p) & (owner[v] != kNobody));
        owner[v] = p;
      }
    }

  const std::size_t each = carried.size() / (mesh.indices.size() / 3);
  std::vector<NewPatch> patches;
  patches.reserve(parts.size());
  // Numbers of vertices within a patch. They count on from patch to patch: a number below a patch's first one is an
  // earlier patch's, so nothing has to be cleared.
  std::vector<std::uint32_t>& local = owner;
  std::fill(local.begin(), local.end(), 0);
  std::uint32_t first_number = 1;
  std::vector<std::uint32_t> room;  // the vertices that a patch uses
  std::vector<std::uint32_t> order;
  next = 0;
  for (const auto& part : parts) {
    NewPatch patch;
    PatchGeometry geometry;
    geometry.indices.resize(3 * part.size());
    if (room.size() < 3 * part.size()) room.resize(3 * part.size());
    std::uint32_t count = 0;
    for (std::uint16_t& index : geometry.indices) {
      // No branch could predict which vertices are new: a mask chooses.
      const std::uint32_t v = corners[next++];
      const std::uint32_t is_new = local[v] < first_number ? 1 : 0;
      const std::uint32_t number = local[v] ^ ((local[v] ^ (first_number + count)) & (0U - is_new));
      local[v] = number;
      room[count] = v;
      count += is_new;
      index = static_cast<std::uint16_t>(number - first_number);
    }
    first_number += count;
    const std::span<const std::uint32_t> used(room.data(), count);
    gather(mesh.positions, used, geometry.positions);
    gather(mesh.normals, used, geometry.normals);
    if (!mesh.colors.empty()) gather(mesh.colors, used, geometry.colors);
    for (const std::uint32_t v : used)
      if (border[v] != 0) patch.border.push_back(mesh.codes[v]);
    std::sort(patch.border.begin(), patch.border.end());
    describe(geometry, lattice, patch.record);
    patch.record.level = static_cast<std::uint16_t>(level);
    patch.encoded = encodePatch(geometry, &order);
    if (!carried.empty()) {
      patch.carried.resize(each * order.size());
      for (std::size_t t = 0; t < order.size(); ++t)
        std::memcpy(&patch.carried[each * t], &carried[each * part[order[t]]], each);
    }
    patches.push_back(std::move(patch));
  }
  return patches;
}

}  // namespace lod::patch::builder
