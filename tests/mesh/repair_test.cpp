// Broken topology is mended and counted; afterwards every triangle is accepted by a half-edge mesh.
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <cmath>

#include "mesh/repair.h"
#include "tests/mesh/mesh_files.h"

namespace {

using namespace mesh_files;
using mesh::RepairCounts;
using mesh::repairMesh;
using Triangles = std::vector<std::array<std::uint32_t, 3>>;

Mesh meshOf(std::vector<glm::vec3> positions, const Triangles& triangles) {
  Mesh mesh;
  mesh.positions = std::move(positions);
  for (const auto& t : triangles) mesh.indices.insert(mesh.indices.end(), t.begin(), t.end());
  return mesh;
}

using HalfEdgeMesh = OpenMesh::TriMesh_ArrayKernelT<>;

/// Triangles that OpenMesh refuses: none for a clean mesh.
std::size_t refusedByOpenMesh(const Mesh& mesh) {
  HalfEdgeMesh half_edges;
  std::vector<HalfEdgeMesh::VertexHandle> vertices;
  for (const glm::vec3& p : mesh.positions) vertices.push_back(half_edges.add_vertex({p.x, p.y, p.z}));
  std::size_t refused = 0;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const auto face =
        half_edges.add_face(vertices[mesh.indices[i]], vertices[mesh.indices[i + 1]], vertices[mesh.indices[i + 2]]);
    refused += face.is_valid() ? 0 : 1;
  }
  for (const auto v : half_edges.vertices()) refused += half_edges.is_manifold(v) ? 0 : 1;
  return refused;
}

RepairCounts repaired(Mesh& mesh, double weld_distance = 0.0) {
  RepairCounts counts;
  repairMesh(mesh, weld_distance, counts);
  EXPECT_EQ(refusedByOpenMesh(mesh), 0U);
  return counts;
}

std::uint64_t of(const RepairCounts& counts, const std::string& name) {
  const auto found = counts.counts.find(name);
  return found == counts.counts.end() ? 0 : found->second;
}

const std::vector<glm::vec3> kTetrahedronCorners{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
const Triangles kTetrahedron{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};

TEST(Repair, LeavesACleanMeshAsItIs) {
  Mesh mesh = meshOf(kTetrahedronCorners, kTetrahedron);
  const Mesh before = mesh;
  const RepairCounts counts = repaired(mesh);
  EXPECT_TRUE(counts.counts.empty());
  EXPECT_EQ(mesh.indices, before.indices);
  EXPECT_EQ(mesh.positions, before.positions);
  EXPECT_TRUE(isClosed(mesh));
}

TEST(Repair, WeldsEqualPositionsAndAveragesColoursAndNormals) {
  // Two triangles with corners of their own along the shared edge; −0 equals 0.
  Mesh mesh = meshOf({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {-0.0F, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {3, 4, 5}});
  mesh.colors = {{10, 0, 0, 255}, {1, 1, 1, 255}, {7, 7, 7, 255}, {21, 0, 0, 255}, {7, 7, 7, 255}, {3, 3, 3, 255}};
  mesh.normals = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 1, 0}, {0, 0, 5}, {0, 0, 1}};
  const RepairCounts counts = repaired(mesh);
  EXPECT_EQ(of(counts, "welded_vertices"), 2U);
  ASSERT_EQ(mesh.positions.size(), 4U);
  EXPECT_EQ(mesh.colors[0], glm::u8vec4(16, 0, 0, 255));
  EXPECT_NEAR(mesh.normals[0].y, std::sqrt(0.5F), 1e-6F);
  EXPECT_NEAR(mesh.normals[0].z, std::sqrt(0.5F), 1e-6F);
  EXPECT_EQ(directedEdges(mesh).size(), 6U);
}

TEST(Repair, WeldsWithinADistanceAcrossCellBorders) {
  // 0.0999 and 0.1001 lie in different cells of 0.1, yet close; 0.4 lies away.
  std::vector<glm::vec3> corners{{0.0999F, 0, 0}, {0.4F, 0, 0},    {0.4F, 0.4F, 0},
                                 {0.1001F, 0, 0}, {0.4F, 0.4F, 0}, {0, 0.4F, 0}};
  Mesh mesh = meshOf(corners, {{0, 1, 2}, {3, 4, 5}});
  EXPECT_EQ(of(repaired(mesh, 0.1), "welded_vertices"), 2U);
  mesh = meshOf(corners, {{0, 1, 2}, {3, 4, 5}});
  EXPECT_EQ(of(repaired(mesh, 0.0), "welded_vertices"), 1U);
  mesh = meshOf(corners, {{0, 1, 2}, {3, 4, 5}});
  EXPECT_EQ(of(repaired(mesh, -1.0), "welded_vertices"), 0U);
}

TEST(Repair, DropsDegenerateAndDuplicateTrianglesAndUnreferencedVertices) {
  Mesh mesh = meshOf({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0, 0}, {9, 9, 9}},
                     {{0, 1, 2}, {0, 1, 1}, {0, 1, 3}, {2, 0, 1}, {1, 0, 2}});
  const RepairCounts counts = repaired(mesh);
  EXPECT_EQ(of(counts, "degenerate_triangles"), 2U);  // a repeated corner; three corners in a line
  EXPECT_EQ(of(counts, "duplicate_triangles"), 2U);   // once in either winding
  EXPECT_EQ(of(counts, "unreferenced_vertices"), 2U);
  EXPECT_EQ(mesh.triangleCount(), 1U);
  EXPECT_EQ(mesh.positions.size(), 3U);
}

TEST(Repair, TurnsTheMinorityOfAPartAndCountsIt) {
  // A strip of five triangles, the third wound wrongly; beside it a whole part of its own, wound its own way.
  Mesh mesh = meshOf(
      {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {2, 0, 0}, {2, 1, 0}, {3, 0, 0}, {9, 0, 0}, {9, 1, 0}, {8, 0, 0}},
      {{0, 2, 1}, {1, 2, 3}, {2, 3, 4}, {3, 4, 5}, {4, 6, 5}, {7, 9, 8}});
  const RepairCounts counts = repaired(mesh);
  EXPECT_EQ(of(counts, "flipped_triangles"), 1U);
  for (const auto& [edge, times] : directedEdges(mesh)) EXPECT_EQ(times, 1) << edge.first << " " << edge.second;
  EXPECT_EQ(mesh.positions.size(), 10U);
  EXPECT_EQ(mesh.triangleCount(), 6U);
}

TEST(Repair, CutsAMobiusStripOnceAndKeepsItsTriangles) {
  // A strip of 12 quads with a half turn: the last pair of corners joins the first crosswise.
  constexpr std::uint32_t kQuads = 12;
  std::vector<glm::vec3> positions;
  for (std::uint32_t q = 0; q < kQuads; ++q) {
    const double turn = 6.283185307179586 * q / kQuads;
    for (const double side : {-0.3, 0.3}) {
      const double r = 1.0 + side * std::cos(turn / 2);
      positions.emplace_back(glm::dvec3(r * std::cos(turn), r * std::sin(turn), side * std::sin(turn / 2)));
    }
  }
  Triangles triangles;
  for (std::uint32_t q = 0; q < kQuads; ++q) {
    const bool last = q + 1 == kQuads;
    const std::uint32_t a = 2 * q, b = 2 * q + 1, c = last ? 1 : 2 * q + 2, d = last ? 0 : 2 * q + 3;
    triangles.push_back({a, c, b});
    triangles.push_back({b, c, d});
  }
  Mesh mesh = meshOf(positions, triangles);
  const RepairCounts counts = repaired(mesh);
  EXPECT_EQ(of(counts, "non_orientable_parts"), 1U);
  EXPECT_EQ(of(counts, "split_non_manifold_vertices"), 2U);
  EXPECT_EQ(mesh.triangleCount(), triangles.size());
}

TEST(Repair, SplitsAVertexWhereTwoFansTouch) {
  // A bow tie: two triangles share vertex 0 only.
  Mesh mesh = meshOf({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {-1, 0, 0}, {-1, -1, 0}}, {{0, 1, 2}, {0, 3, 4}});
  const RepairCounts counts = repaired(mesh);
  EXPECT_EQ(of(counts, "split_non_manifold_vertices"), 1U);
  EXPECT_EQ(of(counts, "non_manifold_edges"), 0U);
  ASSERT_EQ(mesh.positions.size(), 6U);
  EXPECT_EQ(mesh.positions[5], glm::vec3(0.0F));
}

TEST(Repair, TakesAFinOffASheetAndKeepsTheSheetWhole) {
  // Edge 0-1 has the sheet's two triangles and a fin standing on it.
  Mesh mesh = meshOf({{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {-1, 0, 0}, {0, 0, 1}}, {{0, 2, 1}, {0, 1, 3}, {0, 1, 4}});
  const RepairCounts counts = repaired(mesh);
  EXPECT_EQ(of(counts, "non_manifold_edges"), 1U);
  EXPECT_EQ(of(counts, "split_non_manifold_vertices"), 2U);
  EXPECT_EQ(mesh.triangleCount(), 3U);

  // The sheet's edge is still shared: 3 triangles have 9 sides, one edge of them is met twice.
  const auto edges = directedEdges(mesh);
  const auto shared = std::count_if(edges.begin(), edges.end(), [&](const auto& e) {
    return edges.contains({e.first.second, e.first.first});
  });
  EXPECT_EQ(shared, 2);
}

/// The 12 triangles of the unit cube at `corner`, outward; corner k is at bits x = k & 1, y = k & 2, z = k & 4.
void addCube(Mesh& mesh, const glm::vec3& corner) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (int k = 0; k < 8; ++k) mesh.positions.push_back(corner + glm::vec3(k & 1, (k >> 1) & 1, (k >> 2) & 1));
  for (const auto& q : {std::array{0, 2, 3, 1}, std::array{4, 5, 7, 6}, std::array{0, 1, 5, 4}, std::array{2, 6, 7, 3},
                        std::array{0, 4, 6, 2}, std::array{1, 3, 7, 5}})
    for (const auto& t : {std::array{q[0], q[1], q[2]}, std::array{q[0], q[2], q[3]}})
      for (const int i : t) mesh.indices.push_back(first + static_cast<std::uint32_t>(i));
}

TEST(Repair, CubesThatTouchAlongAnEdgeComeApartWhole) {
  Mesh mesh;
  addCube(mesh, {0, 0, 0});
  addCube(mesh, {1, 1, 0});
  const RepairCounts counts = repaired(mesh);
  EXPECT_EQ(of(counts, "welded_vertices"), 2U);
  EXPECT_EQ(of(counts, "non_manifold_edges"), 1U);
  EXPECT_EQ(of(counts, "split_non_manifold_vertices"), 2U);
  EXPECT_TRUE(isClosed(mesh));
  EXPECT_EQ(mesh.triangleCount(), 24U);
}

TEST(Repair, ARandomHeapOfTrianglesBecomesManifoldWithoutLosingOne) {
  // 400 triangles between 40 points: nearly every edge and vertex is non-manifold.
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    std::uint32_t state = seed * 2654435761U;
    const auto random = [&](std::uint32_t below) {
      state = state * 1664525U + 1013904223U;
      return (state >> 8U) % below;
    };
    Mesh mesh;
    for (int v = 0; v < 40; ++v) mesh.positions.emplace_back(random(1000), random(1000), random(1000));
    for (int i = 0; i < 1200; ++i) mesh.indices.push_back(random(40));
    const std::size_t before = mesh.triangleCount();
    const RepairCounts counts = repaired(mesh);
    EXPECT_EQ(mesh.triangleCount() + of(counts, "degenerate_triangles") + of(counts, "duplicate_triangles"), before);
    EXPECT_GT(of(counts, "split_non_manifold_vertices"), 100U);
    for (const auto& [edge, times] : directedEdges(mesh)) ASSERT_EQ(times, 1);

    // Clean is clean: a second pass (without welding, which would undo the cuts) finds nothing.
    RepairCounts again;
    repairMesh(mesh, -1.0, again);
    EXPECT_TRUE(again.counts.empty());
  }
}

TEST(Repair, GivenNormalsOfNoUseAreComputed) {
  auto result = import("n.ply",
                       "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                       "property float nx\nproperty float ny\nproperty float nz\nelement face 1\n"
                       "property list uchar int vertex_indices\nend_header\n"
                       "0 0 0 0 0 0\n1 0 0 nan 0 1\n0 1 0 0 2 0\n3 0 1 2\n");
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(result->mesh.normals[0], glm::vec3(0, 0, 1));
  EXPECT_EQ(result->mesh.normals[1], glm::vec3(0, 0, 1));
  EXPECT_EQ(result->mesh.normals[2], glm::vec3(0, 1, 0));
}

}  // namespace
