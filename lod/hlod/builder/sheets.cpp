#include "lod/hlod/builder/sheets.h"

#include <algorithm>
#include <utility>

#include "base/geometry.h"
#include "lod/hlod/builder/point_clusters.h"
#include "lod/ingest/disjoint_sets.h"

namespace lod::hlod::builder {
namespace {

struct Sheet {
  base::Aabb box;
  bool stays = false;
};

/// The first triangle of each triangle's sheet.
std::vector<std::uint32_t> sheetsOf(const MeshEdges& edges, std::size_t triangles) {
  ingest::DisjointSets sheets(triangles);
  for (const auto& [a, b] : edges.shared) sheets.unite(a / 3, b / 3);
  return std::move(sheets).roots();
}

/// The sheets by their first triangles.
std::vector<Sheet> measureSheets(const NodeMesh& mesh, const MeshEdges& edges,
                                 const std::vector<std::uint32_t>& sheet_of, float size, float room) {
  std::vector<Sheet> sheets(mesh.triangles());
  for (std::size_t t = 0; t < mesh.triangles(); ++t) {
    Sheet& sheet = sheets[sheet_of[t]];
    for (std::size_t k = 0; k < 3; ++k) sheet.box.add(mesh.positions[mesh.indices[3 * t + k]]);
    sheet.stays |= mesh.errorOf(t) > room;
  }
  for (const OpenEdge edge : edges.open) {
    const glm::uvec2 ends = endsOf(edge, mesh.indices);
    if (mesh.on_rim[ends.x] == 0 || mesh.on_rim[ends.y] == 0) sheets[sheet_of[edge / 3]].stays = true;
  }
  for (Sheet& sheet : sheets) sheet.stays |= !sheet.box.empty() && sheet.box.diagonal() > size;
  return sheets;
}

void addPoints(NodeMesh& mesh, std::size_t triangle) {
  visitSamples(mesh, triangle, [&](const MeshPoint& point) { mesh.points.push_back(point); });
  mesh.points_error = std::max(mesh.points_error, mesh.errorOf(triangle));
  if (!mesh.bounds.toward.empty())
    mesh.points_bound = std::max({mesh.points_bound, mesh.bounds.toward[triangle], mesh.bounds.from[triangle]});
}

}  // namespace

void replaceSmallSheets(NodeMesh& mesh, float size, float room) {
  const MeshEdges edges = edgesOf(mesh.indices);
  const std::vector<std::uint32_t> sheet_of = sheetsOf(edges, mesh.triangles());
  const std::vector<Sheet> sheets = measureSheets(mesh, edges, sheet_of, size, room);
  std::size_t kept = 0;
  for (std::size_t t = 0; t < sheet_of.size(); ++t) {
    if (!sheets[sheet_of[t]].stays) {
      addPoints(mesh, t);
      continue;
    }
    for (std::size_t k = 0; k < 3; ++k) mesh.indices[3 * kept + k] = mesh.indices[3 * t + k];
    for (auto* list : {&mesh.bounds.toward, &mesh.bounds.from, &mesh.errors})
      if (!list->empty()) (*list)[kept] = (*list)[t];
    ++kept;
  }
  if (kept == sheet_of.size()) return;
  mesh.indices.resize(3 * kept);
  for (auto* list : {&mesh.bounds.toward, &mesh.bounds.from, &mesh.errors})
    if (!list->empty()) list->resize(kept);
  dropUnusedVertices(mesh);
}

void addFacets(NodeMesh& mesh, float radius) {
  for (const MeshPoint& point : mesh.points) {
    const glm::vec3& n = point.normal;
    const glm::vec3 beside = std::abs(n.x) < 0.5F ? glm::vec3(1.0F, 0.0F, 0.0F) : glm::vec3(0.0F, 1.0F, 0.0F);
    const glm::vec3 u = glm::normalize(glm::cross(n, beside)), v = glm::cross(n, u);
    constexpr float kHalfRoot3 = 0.8660254F;
    for (const glm::vec3& arm : {u, kHalfRoot3 * v - 0.5F * u, -kHalfRoot3 * v - 0.5F * u}) {
      mesh.indices.push_back(static_cast<std::uint32_t>(mesh.positions.size()));
      mesh.positions.push_back(point.position + radius * arm);
      mesh.normals.push_back(n);
      if (!mesh.colors.empty()) mesh.colors.push_back(point.color);
      mesh.on_rim.push_back(1);
    }
  }
}

}  // namespace lod::hlod::builder
