// Files come in as one source: bad coordinates are named, attributes and origins are kept, and each repair is counted.
#include "lod/ingest/staged_build.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <limits>

#include "tests/support/built_hierarchy.h"
#include "tests/support/temporary_directory.h"

namespace {

using namespace lod::ingest;
using support::BuiltHierarchy;
using support::PlyMesh;

class SourceImport : public testing::Test {
 protected:
  /// Writes the text to a new file and returns its path.
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(files_ / name, std::ios::binary) << text;
    return files_ / name;
  }
  base::Result<ImportedSource> import(const std::vector<std::string>& paths) const {
    LUMIGRID_ASSIGN_OR_RETURN(auto directory, WorkDirectory::open(files_ / "work", {}));
    LUMIGRID_ASSIGN_OR_RETURN(const auto input, sourceFromFiles(paths, {}, 2));
    return importSource(directory, input, 2);
  }
  base::Result<lod::patch::builder::HierarchySummary> build(const PlyMesh& mesh) const {
    support::writePly(files_ / "mesh.ply", mesh);
    return lod::patch::builder::buildHierarchyFromFiles({files_ / "mesh.ply"}, {}, files_ / "patch.lgp");
  }
  BuiltHierarchy mustBuild(const PlyMesh& mesh) const {
    const auto summary = build(mesh);
    EXPECT_TRUE(summary) << summary.error().message;
    if (!summary) return {};
    auto built = support::readHierarchy(files_ / "patch.lgp", *summary);
    EXPECT_TRUE(built) << built.error().message;
    return built ? std::move(*built) : BuiltHierarchy();
  }

  support::TemporaryDirectory files_;
};

std::uint64_t repairs(const BuiltHierarchy& built, const std::string& name) {
  const auto found = built.summary.repairs.counts.find(name);
  return found == built.summary.repairs.counts.end() ? 0 : found->second;
}

PlyMesh plyOf(std::vector<glm::dvec3> positions, const std::vector<std::array<std::uint32_t, 3>>& triangles) {
  PlyMesh mesh;
  mesh.positions = std::move(positions);
  for (const auto& t : triangles) mesh.add(t[0], t[1], t[2]);
  return mesh;
}

// ---- Files

TEST_F(SourceImport, namesTheFileAndTheVertexOfABadCoordinate) {
  const struct {
    double coordinate;
    std::string message;
  } cases[] = {{std::numeric_limits<double>::quiet_NaN(), "vertex 1: a coordinate is not finite"},
               {std::numeric_limits<double>::infinity(), "vertex 1: a coordinate is not finite"},
               {1e30, "vertex 1: a coordinate is larger than 1e18"}};
  for (const auto& c : cases) {
    const auto built = build(plyOf({{0, 0, 0}, {1, c.coordinate, 0}, {0, 1, 0}}, {{0, 1, 2}}));
    ASSERT_FALSE(built);
    EXPECT_EQ(built.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_NE(built.error().message.find("mesh.ply: " + c.message), std::string::npos) << built.error().message;
  }
}

TEST_F(SourceImport, refusesNoFileAndAMeshOfDegenerateTriangles) {
  EXPECT_FALSE(sourceFromFiles({}, {}, 1));
  const auto built = build(plyOf({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 0, 2}, {2, 2, 1}}));
  ASSERT_FALSE(built);
  EXPECT_NE(built.error().message.find("no triangle is left after cleaning"), std::string::npos)
      << built.error().message;
}

TEST_F(SourceImport, makesOneSourceOfSeveralFiles) {
  PlyMesh colored = plyOf({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}});
  colored.colors.assign(4, glm::u8vec4(10, 200, 255, 255));
  support::writePly(files_ / "first.ply", colored);
  const auto source = import({files_ / "first.ply", write("second.obj", "v 5 0 0\nv 6 0 0\nv 5 1 0\nf 1 2 3\n")});
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ(source->info.vertices, 7U);
  EXPECT_EQ(source->info.triangles, 3U);
  EXPECT_TRUE(source->info.has_colors);
  EXPECT_EQ(source->info.box_max, glm::dvec3(6, 1, 0));
  ASSERT_EQ(source->info.warnings.size(), 1U);
  EXPECT_NE(source->info.warnings[0].find("second.obj: has no colours"), std::string::npos);
}

TEST_F(SourceImport, keepsTheMillimetersOfSurveyCoordinates) {
  // A 300 m wide field at UTM size has heights in millimetres; the spooled doubles are those of the file.
  PlyMesh mesh;
  for (int v = 0; v < 300; ++v)
    mesh.add(glm::dvec3(4e5 + v + 0.001 * v, 5e6 + 0.377 * ((v * 7919) % 300), 100.0 + 0.001 * (v % 97)));
  for (std::uint32_t t = 0; t < 100; ++t) mesh.add(3 * t, 3 * t + 1, 3 * t + 2);
  support::writePly(files_ / "utm.ply", mesh);
  auto directory = WorkDirectory::open(files_ / "work", {});
  ASSERT_TRUE(directory);
  const auto input = sourceFromFiles({files_ / "utm.ply"}, {}, 1);
  ASSERT_TRUE(input);
  const auto source = importSource(*directory, *input, 1);
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_LT(glm::distance(source->origin, mesh.positions[150]), 400.0);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(source->origin[k], std::round(source->origin[k]));
  const auto spool = openSource(*directory, *source);
  ASSERT_TRUE(spool) << spool.error().message;
  std::vector<glm::dvec3> positions;
  ASSERT_TRUE(spool->forEachVertexBlock([&](const SpooledVertices& block) -> base::Result<void> {
    positions.insert(positions.end(), block.positions.begin(), block.positions.end());
    return {};
  }));
  EXPECT_EQ(positions, mesh.positions);
}

TEST_F(SourceImport, leavesTheOriginOfModelsAroundZeroAtZero) {
  const auto source = import({write("t.obj", "v 0.1 -0.2 0.3\nv 1 0 0.7\nv 0.123456789 1 0\nf 1 2 3\n")});
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ(source->origin, glm::dvec3(0.0));
}

TEST_F(SourceImport, verticesOfDegenerateFacesDoNotCountForTheBox) {
  const auto source = import({write("t.obj", "v 900 900 900\nv 2 0 0\nv 3 0 0\nv 2 1 0\nf 2 3 4\nf 1 1 2\n")});
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ(source->info.box_max, glm::dvec3(3, 1, 0));
  EXPECT_EQ(source->info.referenced, 3U);
}

// ---- The lattice

/// A plane of side² quads of this size, from `corner` on.
void addPlane(PlyMesh& mesh, const glm::dvec3& corner, std::uint32_t side, double quad) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (std::uint32_t y = 0; y <= side; ++y)
    for (std::uint32_t x = 0; x <= side; ++x) mesh.add(corner + quad * glm::dvec3(x, y, 0));
  for (std::uint32_t y = 0; y < side; ++y)
    for (std::uint32_t x = 0; x < side; ++x) {
      const std::uint32_t a = first + y * (side + 1) + x, b = a + side + 1;
      mesh.add(a, a + 1, b), mesh.add(a + 1, b + 1, b);
    }
}

TEST_F(SourceImport, aFinePartOfACoarseMeshKeepsItsTriangles) {
  // So many quads a side are 10000 times smaller than the others: a quarter of all, and one in thirty, which is less
  // than a tenth and more than a hundredth.
  for (const auto& [coarse, fine] : {std::pair(35U, 20U), std::pair(54U, 10U)}) {
    PlyMesh mesh;
    addPlane(mesh, {0, 0, 0}, coarse, 20.0);
    addPlane(mesh, {300, 300, 50}, fine, 0.002);
    const BuiltHierarchy built = mustBuild(mesh);
    EXPECT_TRUE(built.summary.repairs.counts.empty()) << fine;
    EXPECT_EQ(built.summary.triangles, mesh.triangles());
    EXPECT_TRUE(built.summary.warnings.empty()) << fine;
  }
}

TEST_F(SourceImport, sliversCostNoBits) {
  // Beside each quad of one border lie two triangles that reach a ten millionth of its side farther.
  PlyMesh mesh;
  mesh.doubles = true;
  addPlane(mesh, {0, 0, 0}, 40, 1.0);
  support::writePly(files_ / "clean.ply", mesh);
  const auto clean = import({files_ / "clean.ply"});
  ASSERT_TRUE(clean) << clean.error().message;
  const std::uint64_t whole = mesh.triangles();
  for (std::uint32_t quad = 0; quad < 40; ++quad) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    const double x = quad, end = x + 1.0, y = 40.0 + 1e-7;
    mesh.add({x, 40.0, 0}), mesh.add({end, 40.0, 0}), mesh.add({end, y, 0}), mesh.add({x, y, 0});
    mesh.add(first, first + 1, first + 2), mesh.add(first, first + 2, first + 3);
  }
  support::writePly(files_ / "slivers.ply", mesh);
  const auto source = import({files_ / "slivers.ply"});
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ(makeLattice(source->info, glm::dvec3(0.0), 0).bits, makeLattice(clean->info, glm::dvec3(0.0), 0).bits);
  const BuiltHierarchy built = mustBuild(mesh);
  EXPECT_EQ(built.summary.triangles, whole);
  ASSERT_EQ(built.summary.warnings.size(), 1U);
  const std::string& line = built.summary.warnings[0];
  EXPECT_EQ(line.rfind("80 of 3,280 triangles are slivers, whose shortest edge is below the lattice's step", 0), 0U)
      << line;
}

TEST_F(SourceImport, aFarTriangleThatTakesTheLatticeIsNamed) {
  PlyMesh mesh;
  mesh.doubles = true;
  addPlane(mesh, {0, 0, 0}, 10, 0.1);
  mesh.positions.insert(mesh.positions.end(), {{3e7, 0, 0}, {3e7, 900, 0}, {3e7, 0, 900}});
  mesh.add(121, 122, 123);
  const BuiltHierarchy built = mustBuild(mesh);
  EXPECT_EQ(repairs(built, "lattice_collapsed_triangles"), 200U);
  ASSERT_EQ(built.summary.warnings.size(), 1U);
  const std::string& line = built.summary.warnings[0];
  EXPECT_EQ(line.rfind("200 of 201 triangles are smaller than the lattice's step of 14.3", 0), 0U) << line;
  EXPECT_NE(line.find("what lies at (3e+07, "), std::string::npos) << line;
}

TEST_F(SourceImport, lostTrianglesAreToldWithTheirRemedy) {
  SourceInfo info;
  info.triangles = 1000, info.mean_edge = 1.0, info.short_edge = 0.5;
  info.box_max = glm::dvec3(4e6, 10, 10);
  info.lost[14] = info.lost[21] = 0.011;
  const SourceLattice coarse = makeLattice(info, glm::dvec3(0.0), 14);
  EXPECT_EQ(lostTriangles(info, coarse, 10), "");
  const std::string raise = lostTriangles(info, coarse, 11);
  EXPECT_EQ(raise.find("raise --position-bits"), std::string::npos) << raise;  // 21 bits have a step of 1.9
  info.box_max.x = 1e6;
  info.lost[21] = 0.005;
  const std::string finer = lostTriangles(info, makeLattice(info, glm::dvec3(0.0), 14), 11);
  EXPECT_NE(finer.find("raise --position-bits (14 now, 21 at most)"), std::string::npos) << finer;
  // The file's own vertices are what falls together.
  info.coincident = 0.011;
  EXPECT_EQ(lostTriangles(info, coarse, 11), "");
}

TEST_F(SourceImport, shapesThatTheFinestLatticeRoundsAreToldOf) {
  SourceInfo info;
  info.triangles = 1000, info.mean_edge = 1.0, info.short_edge = 0.5;
  info.box_max = glm::dvec3(2e5, 10, 10);
  info.far_place = glm::dvec3(2e5, 0, 0);
  EXPECT_EQ(roundedShapes(info, makeLattice(info, glm::dvec3(0.0), 0)), "");
  info.box_max.x = 4e5;
  const std::string told = roundedShapes(info, makeLattice(info, glm::dvec3(0.0), 0));
  EXPECT_EQ(told.rfind("places are rounded to 0.191, where edges are about 1 long", 0), 0U) << told;
  EXPECT_NE(told.find("as far as (200000, 0, 0): remove what lies there"), std::string::npos) << told;
  EXPECT_EQ(roundedShapes(info, makeLattice(info, glm::dvec3(0.0), 14)), "") << "coarser positions were asked for";
}

// ---- Repairs

const std::vector<glm::dvec3> kTetrahedronCorners{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
const std::vector<std::array<std::uint32_t, 3>> kTetrahedron{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};

TEST_F(SourceImport, repairsNothingOfACleanMesh) {
  const BuiltHierarchy built = mustBuild(plyOf(kTetrahedronCorners, kTetrahedron));
  EXPECT_TRUE(built.summary.repairs.counts.empty());
  EXPECT_EQ(built.summary.triangles, 4U);
}

TEST_F(SourceImport, weldsEqualPositionsAndAveragesTheirColorsAndNormals) {
  // Two triangles have corners of their own along the shared edge; −0 equals 0.
  PlyMesh mesh = plyOf({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {-0.0, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {3, 4, 5}});
  mesh.colors = {{10, 0, 0, 255}, {1, 1, 1, 255}, {7, 7, 7, 255}, {21, 0, 0, 255}, {7, 7, 7, 255}, {3, 3, 3, 255}};
  mesh.normals = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 1, 0}, {0, 0, 5}, {0, 0, 1}};
  const BuiltHierarchy built = mustBuild(mesh);
  EXPECT_EQ(repairs(built, "welded_vertices"), 2U);
  ASSERT_EQ(built.geometry.size(), 1U);
  const lod::patch::PatchGeometry& patch = built.geometry[0];
  ASSERT_EQ(patch.positions.size(), 4U);
  for (std::size_t v = 0; v < 4; ++v) {
    const glm::dvec3 at = built.summary.origin + glm::dvec3(built.hierarchy.lattice.position(patch.positions[v]));
    if (glm::length(at) > 0.1) continue;
    EXPECT_NEAR(patch.colors[v].r, 16, 4);
    EXPECT_LT(patch.colors[v].g, 5);
  }
}

TEST_F(SourceImport, countsDegenerateAndDuplicateTrianglesAndUnreferencedVertices) {
  // One triangle names a corner twice; of three with the same corners one stays.
  const BuiltHierarchy built =
      mustBuild(plyOf({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {9, 9, 9}}, {{0, 1, 2}, {0, 1, 1}, {2, 0, 1}, {0, 1, 2}}));
  EXPECT_EQ(repairs(built, "degenerate_triangles"), 1U);
  EXPECT_EQ(repairs(built, "duplicate_triangles"), 2U);
  EXPECT_EQ(repairs(built, "unreferenced_vertices"), 1U);
  EXPECT_EQ(built.summary.triangles, 1U);
}

TEST_F(SourceImport, aWallOfTwoSheetsKeepsBoth) {
  // The second sheet faces the other way, 4 mm behind the first; where both have the same vertices, one goes.
  const std::vector<glm::dvec3> front{{0, 0, 0}, {3, 0, 0}, {3, 2, 0}, {0, 2, 0}};
  std::vector<glm::dvec3> both = front;
  for (const glm::dvec3& p : front) both.push_back(p + glm::dvec3(0, 0, -0.004));
  const BuiltHierarchy wall = mustBuild(plyOf(both, {{0, 1, 2}, {0, 2, 3}, {4, 6, 5}, {4, 7, 6}}));
  EXPECT_TRUE(wall.summary.repairs.counts.empty());
  EXPECT_EQ(wall.summary.triangles, 4U);
  const BuiltHierarchy sheet = mustBuild(plyOf(front, {{0, 1, 2}, {0, 2, 3}, {0, 2, 1}, {3, 2, 0}}));
  EXPECT_EQ(repairs(sheet, "two_sided_triangles"), 2U);
  EXPECT_EQ(sheet.summary.triangles, 2U);
  ASSERT_EQ(sheet.geometry.size(), 1U);
  for (const glm::vec3& normal : sheet.geometry[0].normals) EXPECT_GT(normal.z, 0.99F);
}

TEST_F(SourceImport, turnsTheMinorityOfAStripAndCountsIt) {
  // A strip of five triangles, the third wound wrongly, beside a part of its own that is wound the other way.
  const BuiltHierarchy built = mustBuild(plyOf(
      {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {2, 0, 0}, {2, 1, 0}, {3, 0, 0}, {9, 0, 0}, {9, 1, 0}, {8, 0, 0}},
      {{0, 2, 1}, {1, 2, 3}, {2, 3, 4}, {3, 4, 5}, {4, 6, 5}, {7, 9, 8}}));
  EXPECT_EQ(repairs(built, "flipped_triangles"), 1U);
  EXPECT_EQ(built.summary.triangles, 6U);
}

/// The 12 triangles of the unit cube at `corner`, outward; corner k is at bits x = k & 1, y = k & 2, z = k & 4.
void addCube(PlyMesh& mesh, const glm::dvec3& corner) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (int k = 0; k < 8; ++k) mesh.add(corner + glm::dvec3(k & 1, (k >> 1) & 1, (k >> 2) & 1));
  for (const auto& q : {std::array{0U, 2U, 3U, 1U}, std::array{4U, 5U, 7U, 6U}, std::array{0U, 1U, 5U, 4U},
                        std::array{2U, 6U, 7U, 3U}, std::array{0U, 4U, 6U, 2U}, std::array{1U, 3U, 7U, 5U}}) {
    mesh.add(first + q[0], first + q[1], first + q[2]);
    mesh.add(first + q[0], first + q[2], first + q[3]);
  }
}

TEST_F(SourceImport, keepsTheTrianglesOfCubesThatTouchAlongAnEdge) {
  PlyMesh mesh;
  addCube(mesh, {0, 0, 0});
  addCube(mesh, {1, 1, 0});
  const BuiltHierarchy built = mustBuild(mesh);
  EXPECT_EQ(repairs(built, "welded_vertices"), 2U);
  EXPECT_EQ(repairs(built, "flipped_triangles"), 0U);
  EXPECT_EQ(built.summary.triangles, 24U);
}

// A height field of 20 × 20 quads with a given edge, as floats store it.
PlyMesh floatsAt(const glm::dvec3& corner, double edge) {
  PlyMesh mesh;
  for (int y = 0; y <= 20; ++y)
    for (int x = 0; x <= 20; ++x) mesh.add(glm::dvec3(glm::vec3(corner + edge * glm::dvec3(x, y, x * y % 3))));
  for (std::uint32_t y = 0; y < 20; ++y)
    for (std::uint32_t x = 0; x < 20; ++x) {
      const std::uint32_t a = 21 * y + x;
      mesh.add(a, a + 1, a + 22);
      mesh.add(a, a + 22, a + 21);
    }
  return mesh;
}

TEST_F(SourceImport, floatsTooCoarseForTheirTrianglesAreNamed) {
  const BuiltHierarchy coarse = mustBuild(floatsAt({500'000, 9'800'000, 2500}, 0.3));
  ASSERT_EQ(coarse.summary.warnings.size(), 1U);
  EXPECT_NE(coarse.summary.warnings[0].find("32-bit floats are 1 apart"), std::string::npos)
      << coarse.summary.warnings[0];
  EXPECT_TRUE(mustBuild(floatsAt({5, 9, 2}, 0.3)).summary.warnings.empty());
  EXPECT_TRUE(mustBuild(floatsAt({500'000, 9'800'000, 2500}, 30.0)).summary.warnings.empty());
}

TEST_F(SourceImport, losesNoTriangleOfARandomHeapUncounted) {
  // 400 triangles between 40 points: nearly every edge and vertex is non-manifold.
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    std::uint32_t state = seed * 2654435761U;
    const auto random = [&](std::uint32_t below) {
      state = state * 1664525U + 1013904223U;
      return (state >> 8U) % below;
    };
    PlyMesh mesh;
    for (int v = 0; v < 40; ++v) mesh.add(glm::dvec3(random(1000), random(1000), random(1000)));
    for (int i = 0; i < 1200; ++i) mesh.indices.push_back(random(40));
    const BuiltHierarchy built = mustBuild(mesh);
    EXPECT_EQ(built.summary.triangles + repairs(built, "degenerate_triangles") + repairs(built, "duplicate_triangles") +
                  repairs(built, "two_sided_triangles") + repairs(built, "lattice_collapsed_triangles"),
              400U + repairs(built, "added_triangles"));
    EXPECT_GT(repairs(built, "degenerate_triangles"), 0U);
  }
}

TEST(StagedBuild, pointsThatAreLostOnTheLatticeAreToldAndCopiesAreNot) {
  SourceInfo info;
  info.vertices = 1000;
  info.far_place = {1e7, 0.0, 0.0};
  const SourceLattice lattice;
  EXPECT_EQ(lostPoints(info, lattice, 500), "");
  EXPECT_NE(lostPoints(info, lattice, 900).find("900 of 1,000 points"), std::string::npos);
  EXPECT_NE(lostPoints(info, lattice, 900).find("(1e+07, 0, 0) makes"), std::string::npos)
      << lostPoints(info, lattice, 900);
  info.triangles = 1;
  EXPECT_EQ(lostPoints(info, lattice, 900), "");
}

}  // namespace
