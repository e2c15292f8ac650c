#include "lod/build/lattice.h"

#include <algorithm>
#include <cmath>

#include "lod/patch/codec.h"

namespace lod::build {
namespace {

using base::Error;
using base::ErrorCode;

base::Result<void> check(const Mesh& mesh) {
  if (mesh.indices.size() < 3) return Error{ErrorCode::kInvalidInput, "the mesh has no triangles"};
  if (mesh.indices.size() / 3 >= (std::uint64_t{1} << 31))
    return Error{ErrorCode::kUnsupported, "more than 2^31 triangles in one mesh: split it into several scenes"};
  for (std::size_t i = 0; i < mesh.indices.size(); ++i)
    if (mesh.indices[i] >= mesh.positions.size())
      return Error{ErrorCode::kInvalidInput, "triangle " + std::to_string(i / 3) + ": vertex " +
                                                 std::to_string(mesh.indices[i]) + " is out of range (" +
                                                 std::to_string(mesh.positions.size()) + " vertices)"};
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    if (const glm::vec3& p = mesh.positions[v]; !std::isfinite(p.x + p.y + p.z))
      return Error{ErrorCode::kInvalidInput, "vertex " + std::to_string(v) + " has a position that is not a number"};
  return {};
}

lod::patch::Lattice makeLattice(const base::Aabb& box, std::uint32_t bits) {
  const glm::dvec3 size = glm::dvec3(box.max) - glm::dvec3(box.min);
  const double longest = std::max({size.x, size.y, size.z});
  return {glm::dvec3(box.min), longest > 0.0 ? longest / static_cast<double>((1U << bits) - 1) : 1.0};
}

std::vector<KeyedIndex> sortedPoints(const Mesh& mesh, const lod::patch::Lattice& lattice, std::uint32_t bits) {
  std::vector<KeyedIndex> points(mesh.positions.size());
  const double last = static_cast<double>((1U << bits) - 1);
  for (std::uint32_t v = 0; v < points.size(); ++v) {
    const glm::dvec3 q = glm::round((glm::dvec3(mesh.positions[v]) - lattice.origin) / lattice.step);
    points[v] = {mortonCode(glm::ivec3(glm::clamp(q, 0.0, last))), v};
  }
  radixSort(points, 3 * bits);
  return points;
}

// One vertex for each lattice point in use. Fills weld: vertex of the mesh -> vertex of the result.
void weld(const Mesh& mesh, std::span<const KeyedIndex> points, LatticeMesh& out, std::vector<std::uint32_t>& weld_to) {
  const bool colored = !mesh.colors.empty();
  weld_to.resize(points.size());
  for (std::size_t begin = 0; begin < points.size();) {
    glm::uvec3 color(0);
    std::size_t end = begin;
    for (; end < points.size() && points[end].key == points[begin].key; ++end) {
      weld_to[points[end].index] = static_cast<std::uint32_t>(out.positions.size());
      if (colored) color += glm::uvec3(mesh.colors[points[end].index]);
    }
    const auto count = static_cast<unsigned>(end - begin);
    out.positions.push_back(mortonPoint(points[begin].key));
    if (colored) out.colors.push_back(glm::u8vec4(glm::u8vec3((color + count / 2) / count), 255));
    begin = end;
  }
  out.repairs.add("lattice_welded_vertices", points.size() - out.positions.size());
}

void takeTriangles(const Mesh& mesh, std::span<const std::uint32_t> weld_to, LatticeMesh& out) {
  // Those that keep three different corners, sorted by voxel.
  std::vector<std::uint64_t> codes(out.positions.size());
  for (std::size_t v = 0; v < codes.size(); ++v) codes[v] = mortonCode(out.positions[v]);
  std::vector<KeyedIndex> order;
  order.reserve(mesh.triangleCount());
  for (std::uint32_t t = 0; t < mesh.triangleCount(); ++t) {
    const std::uint32_t* c = &mesh.indices[3 * std::size_t{t}];
    const std::uint32_t a = weld_to[c[0]], b = weld_to[c[1]], d = weld_to[c[2]];
    if (a != b && b != d && d != a) order.push_back({medianCode(codes[a], codes[b], codes[d]), t});
  }
  radixSort(order, 3 * out.bits);
  out.repairs.add("lattice_collapsed_triangles", mesh.triangleCount() - order.size());

  out.indices.resize(3 * order.size());
  for (std::uint32_t t = 0; t < order.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k)
      out.indices[3 * std::size_t{t} + k] = weld_to[mesh.indices[3 * std::size_t{order[t].index} + k]];
    order[t].index = t;
  }
  out.sorted = std::move(order);
}

// The mesh's own normals averaged over welded vertices, or area-weighted ones from the triangles; as they will be
// stored.
void takeNormals(const Mesh& mesh, std::span<const std::uint32_t> weld_to, LatticeMesh& out) {
  out.normals.assign(out.positions.size(), glm::vec3(0.0F));
  if (!mesh.normals.empty()) {
    for (std::size_t v = 0; v < weld_to.size(); ++v) out.normals[weld_to[v]] += mesh.normals[v];
  } else {
    for (std::size_t i = 0; i < out.indices.size(); i += 3) {
      const std::uint32_t* c = &out.indices[i];
      const glm::vec3 a(out.positions[c[0]]);
      const glm::vec3 n = glm::cross(glm::vec3(out.positions[c[1]]) - a, glm::vec3(out.positions[c[2]]) - a);
      for (int k = 0; k < 3; ++k) out.normals[c[k]] += n;
    }
  }
  for (glm::vec3& n : out.normals) {
    const float length = glm::length(n);
    n = lod::patch::quantizedNormal(length > 0.0F && std::isfinite(length) ? n / length : glm::vec3(0.0F, 0.0F, 1.0F));
  }
}

}  // namespace

std::uint32_t chooseLatticeBits(const Mesh& mesh) {
  const std::size_t stride = std::max<std::size_t>(1, mesh.triangleCount() / 500'000);
  double log_sum = 0.0;
  double count = 0.0;
  for (std::size_t t = 0; t < mesh.triangleCount(); t += stride) {
    for (std::size_t k = 0; k < 3; ++k) {
      const glm::dvec3 edge = glm::dvec3(mesh.positions[mesh.indices[3 * t + k]]) -
                              glm::dvec3(mesh.positions[mesh.indices[3 * t + (k + 1) % 3]]);
      if (const double length2 = glm::dot(edge, edge); length2 > 0.0) log_sum += 0.5 * std::log(length2), count += 1.0;
    }
  }
  const double longest = mesh.box().longest();
  if (count == 0.0 || longest <= 0.0) return 10;
  const double steps = 16.0 * longest / std::exp(log_sum / count);
  return static_cast<std::uint32_t>(
      std::clamp(std::ceil(std::log2(steps + 1.0)), 10.0, static_cast<double>(kMaxLatticeBits)));
}

base::Result<LatticeMesh> latticeMesh(const Mesh& mesh, std::uint32_t bits) {
  LUMIGRID_TRY(check(mesh));
  LatticeMesh out;
  out.bits = bits != 0 ? bits : chooseLatticeBits(mesh);
  out.lattice = makeLattice(mesh.box(), out.bits);

  std::vector<std::uint32_t> weld_to;
  weld(mesh, sortedPoints(mesh, out.lattice, out.bits), out, weld_to);
  takeTriangles(mesh, weld_to, out);
  if (out.indices.empty())
    return Error{ErrorCode::kInvalidInput, "no triangle keeps its area on a lattice of " + std::to_string(out.bits) +
                                               " bits: the mesh has no extent, or raise the position bits"};
  takeNormals(mesh, weld_to, out);
  return out;
}

}  // namespace lod::build
