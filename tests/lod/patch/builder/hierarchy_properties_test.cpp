// These properties hold for every hierarchy: cuts for any view have no crack, counts do not depend on the scale, and
// bytes do not depend on threads.
#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>

#include <glm/gtc/matrix_transform.hpp>

#include "base/file.h"
#include "tests/lod/patch/builder/built_cut.h"
#include "tests/lod/patch/builder/built_file.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::patch::builder;
using support::BuiltHierarchy;
using support::LatticeEdge;
using support::Mesh;
using support::PlyMesh;

BuiltHierarchy mustBuild(const Mesh& mesh, const HierarchyOptions& options = support::smallPatches()) {
  base::Result<BuiltHierarchy> built = support::builtHierarchy(mesh, options);
  EXPECT_TRUE(built) << built.error().message;
  return built ? std::move(*built) : BuiltHierarchy{};
}

// Returns a view from anywhere in and around the model to anywhere near it, at any tolerance.
lod::patch::CutRequest randomRequest(const lod::patch::Hierarchy& h, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  auto direction = [&] { return glm::normalize(glm::dvec3(normal(random), normal(random), normal(random))); };
  const base::Sphere bounds = h.groups[0].bounds;
  const auto radius = static_cast<double>(bounds.radius);
  const glm::dvec3 center(bounds.center);
  base::ViewCamera view;
  view.position = center + radius * (0.3 + 2.0 * unit(random) * unit(random)) * direction();
  view.direction = glm::normalize(center + 0.5 * radius * unit(random) * direction() - view.position);
  view.up = std::abs(view.direction.z) < 0.9 ? glm::dvec3(0, 0, 1) : glm::dvec3(1, 0, 0);
  view.fov_y = 0.3 + 1.2 * unit(random);
  lod::patch::CutRequest request;
  request.near_plane = static_cast<float>(1e-3 * radius);
  request.camera = base::cameraFromView(view, glm::dvec3(0.0), request.near_plane, 10.0F * bounds.radius);
  request.tolerance_px = static_cast<float>(std::pow(10.0, 3.0 * unit(random) - 0.3));
  request.cull = false;  // culled patches would leave open edges
  return request;
}

// The levels that a cut draws from.
std::pair<std::uint32_t, std::uint32_t> levelsOf(const lod::patch::Hierarchy& h,
                                                 const std::vector<std::uint32_t>& patches) {
  std::pair<std::uint32_t, std::uint32_t> range{h.patches[patches.front()].level, 0};
  for (const std::uint32_t p : patches) {
    range.first = std::min<std::uint32_t>(range.first, h.patches[p].level);
    range.second = std::max<std::uint32_t>(range.second, h.patches[p].level);
  }
  return range;
}

struct NamedMesh {
  const char* name;
  Mesh mesh;
};

std::vector<NamedMesh> closedMeshes() {
  Mesh pair = support::bumpySphere(40, 60);  // one within the other
  const Mesh inner = support::torus(60, 40);
  const auto base = static_cast<std::uint32_t>(pair.positions.size());
  for (const glm::vec3& p : inner.positions) pair.positions.push_back(0.4F * p);
  for (const std::uint32_t v : inner.indices) pair.indices.push_back(base + v);
  return {{"sphere", support::bumpySphere(90, 130)},
          {"torus", support::torus(150, 90)},
          {"rough sphere", support::bumpySphere(60, 90, 0.3F)},
          {"pair", pair},
          {"components", support::tinyComponents(2000)}};
}

TEST(HierarchyProperties, anyViewOfAClosedMeshHasNoCrack) {
  std::mt19937 random(42);
  int mixed = 0;
  for (const auto& [name, mesh] : closedMeshes()) {
    const BuiltHierarchy built = mustBuild(mesh);
    ASSERT_FALSE(built.geometry.empty()) << name;
    for (int view = 0; view < 50; ++view) {
      const auto request = randomRequest(built.hierarchy, random);
      const auto cut = lod::patch::selectCut(built.hierarchy, request).patches;
      ASSERT_FALSE(cut.empty());
      EXPECT_EQ(support::openEdges(built, cut), 0U)
          << name << ", view " << view << ", " << request.tolerance_px << " px";
      const auto [finest, coarsest] = levelsOf(built.hierarchy, cut);
      mixed += finest < coarsest ? 1 : 0;
    }
  }
  EXPECT_GT(mixed, 100) << "too few views mix levels to say much";
}

// --normals facets: leaves keep their normals, and the levels above have nearly the same, in fewer bytes.
TEST(HierarchyProperties, normalsOfFacetsAreNearThoseOfVerticesAndTakeFewerBytes) {
  const auto mesh = support::torus(150, 90);
  HierarchyOptions options = support::smallPatches();
  const BuiltHierarchy with_all = mustBuild(mesh, options);
  options.normals_beside_colors = options.normals_without_colors = lod::patch::StoredNormals::kOfFacets;
  const BuiltHierarchy of_facets = mustBuild(mesh, options);
  ASSERT_EQ(with_all.geometry.size(), of_facets.geometry.size());
  double cosines = 0.0, vertices = 0.0;
  for (std::size_t p = 0; p < with_all.geometry.size(); ++p) {
    const auto& stored = with_all.geometry[p];
    const auto& facets = of_facets.geometry[p];
    ASSERT_EQ(stored.positions, facets.positions);
    if (with_all.hierarchy.patches[p].level == 0) {
      EXPECT_EQ(stored.normals, facets.normals);
      continue;
    }
    for (std::size_t v = 0; v < stored.normals.size(); ++v, vertices += 1.0)
      cosines += static_cast<double>(glm::dot(stored.normals[v], facets.normals[v]));
  }
  ASSERT_GT(vertices, 0.0);
  EXPECT_GT(cosines / vertices, 0.99);
  const auto bytesOf = [](const BuiltHierarchy& built) {
    std::uint64_t bytes = 0;
    for (const auto& group : built.hierarchy.groups) bytes += group.block_bytes;
    return bytes;
  };
  EXPECT_LT(bytesOf(of_facets), bytesOf(with_all));
}

// --regroup off builds the paper's binary tree: neighbours are merged in pairs, level by level.
TEST(HierarchyProperties, theBinaryTreeHalvesItsPatchesAndAnyViewHasNoCrack) {
  std::mt19937 random(46);
  HierarchyOptions options = support::smallPatches();
  options.regroup = false;
  const BuiltHierarchy built = mustBuild(support::torus(150, 90), options);
  const auto& levels = built.summary.levels;
  ASSERT_GE(levels.size(), 6U);
  for (std::size_t l = 1; l < levels.size(); ++l) {
    EXPECT_EQ(levels[l].patches, (levels[l - 1].patches + 1) / 2) << "level " << l;
    EXPECT_LT(levels[l].triangles, levels[l - 1].triangles) << "level " << l;
    EXPECT_GE(levels[l].max_error, levels[l - 1].max_error) << "level " << l;
    EXPECT_EQ(support::openEdges(built, support::levelCut(built.hierarchy, static_cast<std::uint32_t>(l))), 0U);
  }
  for (std::size_t g = 1; g < built.hierarchy.groups.size(); ++g) EXPECT_LE(built.hierarchy.groups[g].patch_count, 2U);
  for (int view = 0; view < 50; ++view) {
    const auto request = randomRequest(built.hierarchy, random);
    const auto cut = lod::patch::selectCut(built.hierarchy, request).patches;
    EXPECT_EQ(support::openEdges(built, cut), 0U) << "view " << view << ", " << request.tolerance_px << " px";
  }
}

TEST(HierarchyProperties, missingGroupsLeaveNoCracks) {
  std::mt19937 random(43);
  const BuiltHierarchy built = mustBuild(support::torus(150, 90));
  for (int view = 0; view < 50; ++view) {
    std::vector<std::uint8_t> here(built.hierarchy.groups.size());
    for (std::uint8_t& h : here) h = random() % 4 != 0 ? 1 : 0;
    here[0] = 1;
    auto request = randomRequest(built.hierarchy, random);
    request.tolerance_px = 0.0F;
    const auto cut =
        lod::patch::selectCut(built.hierarchy, request, [&](std::uint32_t g) { return here[g] != 0; }).patches;
    EXPECT_EQ(support::openEdges(built, cut), 0U) << "view " << view;
  }
}

TEST(HierarchyProperties, aBudgetOfTrianglesMakesNoCrack) {
  std::mt19937 random(44);
  const BuiltHierarchy built = mustBuild(support::torus(150, 90));
  for (int view = 0; view < 50; ++view) {
    auto request = randomRequest(built.hierarchy, random);
    request.tolerance_px = 0.0F;
    request.max_triangles = 300 + random() % 20000;
    const auto cut = lod::patch::selectCut(built.hierarchy, request);
    EXPECT_LE(cut.triangles, request.max_triangles);
    EXPECT_EQ(support::openEdges(built, cut.patches), 0U) << "view " << view;
  }
}

glm::vec3 middle(const BuiltHierarchy& built, const LatticeEdge& e) {
  const lod::Lattice& lattice = built.hierarchy.lattice;
  return 0.5F * (lattice.position(e.from) + lattice.position(e.to));
}

// The border of an open mesh may be simplified, but stays one: each open edge of a cut lies along the source's border,
// and there are no more than in the source.
TEST(HierarchyProperties, anyViewOfAnOpenMeshHasOnlyTheSourcesBorder) {
  std::mt19937 random(45);
  const BuiltHierarchy built = mustBuild(support::openGrid(120));
  const float top = built.summary.levels.back().max_error;
  const auto leaves = support::openEdgesOf(built, support::levelCut(built.hierarchy, 0));
  ASSERT_EQ(leaves.size(), 480U);
  for (int view = 0; view < 50; ++view) {
    const auto request = randomRequest(built.hierarchy, random);
    const auto open = support::openEdgesOf(built, lod::patch::selectCut(built.hierarchy, request).patches);
    EXPECT_LE(open.size(), leaves.size());
    EXPECT_GE(open.size(), 4U);
    for (const LatticeEdge& e : open) {
      const glm::vec3 m = middle(built, e);
      const float off = std::min({m.x, m.y, 1.0F - m.x, 1.0F - m.y});
      EXPECT_LE(off, top) << "view " << view << ": an open edge at " << m.x << " " << m.y << ", "
                          << request.tolerance_px << " px";
    }
  }
}

TEST(HierarchyProperties, aViewOfTheLeavesIsTheSource) {
  for (const Mesh& mesh : {support::torus(90, 60), support::openGrid(60)}) {
    const BuiltHierarchy built = mustBuild(mesh);
    lod::patch::CutRequest request;
    request.camera = base::cameraFromView({}, glm::dvec3(0.0), 0.01F, 10.0F);
    request.tolerance_px = 0.0F;
    request.cull = false;
    const lod::patch::Cut cut = lod::patch::selectCut(built.hierarchy, request);
    EXPECT_EQ(cut.triangles, mesh.triangleCount());
    EXPECT_EQ(cut.error_px, 0.0F);
  }
}

class WrittenProperties : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              (std::string("hierarchy_properties_") + testing::UnitTest::GetInstance()->current_test_info()->name() +
               std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  HierarchySummary build(const PlyMesh& mesh, const HierarchyOptions& options = support::smallPatches()) {
    writePly(path("mesh.ply"), mesh);
    const auto summary = buildHierarchyFromFiles({path("mesh.ply")}, options, path("out.lgp"));
    EXPECT_TRUE(summary) << summary.error().message;
    return summary ? *summary : HierarchySummary{};
  }

  std::filesystem::path folder_;
};

void expectScaled(const HierarchySummary& plain, const HierarchySummary& scaled, double scale, double rounding = 1e-3) {
  ASSERT_EQ(plain.levels.size(), scaled.levels.size()) << "scale " << scale;
  for (std::size_t l = 0; l < plain.levels.size(); ++l) {
    EXPECT_EQ(scaled.levels[l].triangles, plain.levels[l].triangles) << "scale " << scale << ", level " << l;
    EXPECT_EQ(scaled.levels[l].patches, plain.levels[l].patches) << "scale " << scale << ", level " << l;
    const double error = plain.levels[l].max_error;
    EXPECT_NEAR(scaled.levels[l].max_error / scale, error, rounding * error) << "scale " << scale << ", level " << l;
  }
}

TEST_F(WrittenProperties, aPowerOfTwoScalesTheErrorsAndChangesNothingElse) {
  for (const Mesh& mesh : {support::torus(90, 60), support::bumpySphere(60, 90), support::openGrid(70)}) {
    const HierarchySummary plain = build(PlyMesh(mesh));
    for (const double scale : {std::ldexp(1.0, -20), std::ldexp(1.0, 20)})
      expectScaled(plain, build(PlyMesh(mesh, scale)), scale);
  }
}

// Such factors round every coordinate, so vertices midway between two lattice points may go to the other one. Turned
// meshes have none there.
PlyMesh turned(const Mesh& mesh, double scale) {
  PlyMesh out(mesh);
  const glm::dmat3 turn(glm::rotate(glm::dmat4(1.0), 0.7, glm::normalize(glm::dvec3(1.0, 2.0, -0.6))));
  for (glm::dvec3& p : out.positions) p = scale * (turn * p);
  return out;
}

TEST_F(WrittenProperties, aMillionthAndAMillionScaleTheErrorsAndChangeNothingElse) {
  constexpr double kRounding = 1.0 / 64;  // errors have seven significant bits, which other factors round elsewhere
  for (const Mesh& mesh : {support::torus(90, 60), support::bumpySphere(60, 90), support::openGrid(70)}) {
    const HierarchySummary plain = build(turned(mesh, 1.0));
    for (const double scale : {1e-6, 1e6}) expectScaled(plain, build(turned(mesh, scale)), scale, kRounding);
  }
}

TEST_F(WrittenProperties, bytesDoNotDependOnThreadsOrMemory) {
  HierarchyOptions options = support::smallPatches();
  std::vector<base::Bytes> files;
  const std::pair<unsigned, std::uint64_t> choices[] = {
      {1, lod::ingest::kMinMemory}, {2, 0}, {3, lod::ingest::kMinMemory}, {4, 0}, {7, 0}};
  for (const Mesh& mesh : {support::torus(150, 100), support::triangleSoup(8000)}) {
    files.clear();
    for (const auto& [threads, memory] : choices) {
      options.limits.threads = threads;
      options.limits.memory_bytes = memory;
      build(PlyMesh(mesh), options);
      files.push_back(*base::readFile(path("out.lgp")));
      EXPECT_TRUE(files.back() == files.front()) << threads << " threads";
    }
  }
}

}  // namespace
