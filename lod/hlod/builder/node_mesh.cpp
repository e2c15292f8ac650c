#include "lod/hlod/builder/node_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace lod::hlod::builder {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
constexpr float kUnitSteps = 32767.0F;
constexpr float kColorSteps = 128.0F;

base::Error notAMesh() {
  return {base::ErrorCode::kInvalidInput, "the builder's own file: no mesh"};
}

struct Side {
  std::uint32_t upper_end = 0;
  OpenEdge edge = 0;
};

/// Visits the sides of each edge. All lie by the lower of their ends, sorted by counting; few have the same.
template <class Visit>
void visitEdges(std::span<const std::uint32_t> indices, const Visit& visit) {
  const auto count = static_cast<OpenEdge>(indices.size());
  std::vector<std::uint32_t> first(indices.empty() ? 1 : *std::max_element(indices.begin(), indices.end()) + 2, 0);
  for (OpenEdge edge = 0; edge < count; ++edge) {
    const glm::uvec2 ends = endsOf(edge, indices);
    ++first[std::min(ends.x, ends.y) + 1];
  }
  for (std::size_t v = 1; v < first.size(); ++v) first[v] += first[v - 1];
  std::vector<Side> sides(count);
  for (OpenEdge edge = 0; edge < count; ++edge) {
    const glm::uvec2 ends = endsOf(edge, indices);
    sides[first[std::min(ends.x, ends.y)]++] = {std::max(ends.x, ends.y), edge};
  }
  // Now first[v] is where the edges of v end.
  for (std::size_t v = 0, begin = 0; v < first.size(); begin = first[v++]) {
    const std::span<Side> around(sides.data() + begin, first[v] - begin);
    std::sort(around.begin(), around.end(), [](const Side& a, const Side& b) { return a.upper_end < b.upper_end; });
    for (std::size_t i = 0, end = 0; i < around.size(); i = end) {
      while (end < around.size() && around[end].upper_end == around[i].upper_end) ++end;
      visit(around.subspan(i, end - i));
    }
  }
}

void writeNormal(base::ByteWriter& out, const glm::vec3& n) {
  out.write(glm::i16vec3(glm::round(n * kUnitSteps)));
}
void writeColor(base::ByteWriter& out, const glm::vec3& c) {
  out.write(glm::u16vec3(glm::round(c * kColorSteps)));
}
glm::vec3 readNormal(base::ByteReader& in) {
  const glm::vec3 n(in.read<glm::i16vec3>());
  const float length = glm::length(n);
  return length > 0.0F ? n / length : glm::vec3(0.0F, 0.0F, 1.0F);
}
glm::vec3 readColor(base::ByteReader& in) {
  return glm::vec3(in.read<glm::u16vec3>()) / kColorSteps;
}

}  // namespace

std::vector<OpenEdge> openEdges(std::span<const std::uint32_t> indices) {
  std::vector<OpenEdge> open;
  visitEdges(indices, [&](std::span<const Side> sides) {
    if (sides.size() == 1) open.push_back(sides[0].edge);
  });
  std::sort(open.begin(), open.end());
  return open;
}

MeshEdges edgesOf(std::span<const std::uint32_t> indices) {
  MeshEdges edges;
  edges.shared.reserve(indices.size() / 2);
  visitEdges(indices, [&](std::span<const Side> sides) {
    if (sides.size() == 1) edges.open.push_back(sides[0].edge);
    if (sides.size() == 2) edges.shared.push_back({sides[0].edge, sides[1].edge});
  });
  return edges;
}

base::Bytes meshBytes(const NodeMesh& mesh) {
  base::ByteWriter out;
  out.write(mesh.corner);
  out.f32(mesh.error);
  out.u32(static_cast<std::uint32_t>(mesh.positions.size()));
  out.u32(static_cast<std::uint32_t>(mesh.triangles()));
  out.u8(mesh.colors.empty() ? 0 : 1);
  for (const glm::vec3& p : mesh.positions) out.write(glm::ivec3(p));
  for (const glm::vec3& n : mesh.normals) writeNormal(out, n);
  for (const glm::vec3& c : mesh.colors) writeColor(out, c);
  out.bytes(mesh.on_rim);
  for (const std::uint32_t index : mesh.indices) out.u32(index);
  const bool exact = mesh.bounds.toward.empty();
  out.u8(exact ? 0 : 1);
  for (std::size_t t = 0; !exact && t < mesh.triangles(); ++t) {
    out.u16(patch::builder::errorCode(mesh.bounds.toward[t]));
    out.u16(patch::builder::errorCode(mesh.bounds.from[t]));
  }
  out.f32(mesh.points_error);
  out.f32(mesh.points_bound);
  out.u32(static_cast<std::uint32_t>(mesh.points.size()));
  for (const MeshPoint& point : mesh.points) {
    out.write(point.position);
    writeNormal(out, point.normal);
    writeColor(out, point.color);
  }
  return out.takeBytes();
}

base::Result<NodeMesh> readMesh(base::ByteView bytes) {
  base::ByteReader in(bytes);
  NodeMesh mesh;
  mesh.corner = in.read<glm::ivec3>();
  mesh.error = in.f32();
  const std::size_t vertices = in.u32();
  const std::size_t triangles = in.u32();
  const bool colors = in.u8() != 0;
  if (!in.ok() || vertices > in.remaining() || triangles > in.remaining()) return notAMesh();
  mesh.positions.reserve(vertices);
  for (std::size_t v = 0; v < vertices; ++v) mesh.positions.emplace_back(in.read<glm::ivec3>());
  mesh.normals.reserve(vertices);
  for (std::size_t v = 0; v < vertices; ++v) mesh.normals.push_back(readNormal(in));
  for (std::size_t v = 0; colors && v < vertices; ++v) mesh.colors.push_back(readColor(in));
  const base::ByteView on_rim = in.bytes(vertices);
  mesh.on_rim.assign(on_rim.begin(), on_rim.end());
  mesh.indices.reserve(3 * triangles);
  for (std::size_t i = 0; i < 3 * triangles; ++i) mesh.indices.push_back(in.u32());
  if (in.u8() != 0) {
    for (std::size_t t = 0; t < triangles; ++t) {
      mesh.bounds.toward.push_back(patch::builder::errorOfCode(in.u16()));
      mesh.bounds.from.push_back(patch::builder::errorOfCode(in.u16()));
    }
  }
  mesh.points_error = in.f32();
  mesh.points_bound = in.f32();
  const std::size_t points = in.u32();
  if (!in.ok() || points > in.remaining()) return notAMesh();
  mesh.points.resize(points);
  for (MeshPoint& point : mesh.points) {
    point.position = in.read<glm::vec3>();
    point.normal = readNormal(in);
    point.color = readColor(in);
  }
  const bool in_range =
      std::all_of(mesh.indices.begin(), mesh.indices.end(), [&](std::uint32_t index) { return index < vertices; });
  if (!in.ok() || in.remaining() != 0 || !in_range) return notAMesh();
  return mesh;
}

void dropUnusedVertices(NodeMesh& mesh) {
  std::vector<std::uint32_t> number(mesh.positions.size(), kNone);
  NodeMesh kept;
  for (std::uint32_t& index : mesh.indices) {
    if (number[index] == kNone) {
      number[index] = static_cast<std::uint32_t>(kept.positions.size());
      kept.positions.push_back(mesh.positions[index]);
      kept.normals.push_back(mesh.normals[index]);
      if (!mesh.colors.empty()) kept.colors.push_back(mesh.colors[index]);
      kept.on_rim.push_back(mesh.on_rim[index]);
    }
    index = number[index];
  }
  mesh.positions = std::move(kept.positions);
  mesh.normals = std::move(kept.normals);
  mesh.colors = std::move(kept.colors);
  mesh.on_rim = std::move(kept.on_rim);
}

}  // namespace lod::hlod::builder
