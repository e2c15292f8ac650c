// Whole builds of meshes: what the file states is checked against the source by sampling.
#include "lod/hlod/builder/build.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "base/file.h"
#include "lod/disk_bytes.h"
#include "lod/hlod/block.h"
#include "lod/hlod/check_file.h"
#include "tests/support/ply_file.h"
#include "tests/support/surface_distance.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::hlod;
using namespace lod::hlod::builder;

class HlodBuild : public testing::Test {
 protected:
  std::string path() const { return directory_ / "hlod.lgh"; }

  base::Result<BuildSummary> build(const support::Mesh& mesh, BuildOptions options,
                                   const glm::dvec3& offset = glm::dvec3(0.0)) {
    support::PlyMesh ply;
    ply.doubles = true;
    for (const glm::vec3& p : mesh.positions) ply.positions.push_back(glm::dvec3(p) + offset);
    ply.colors = mesh.colors;
    ply.indices = mesh.indices;
    writePly(directory_ / "mesh.ply", ply);
    return buildFromFiles({directory_ / "mesh.ply"}, options, path());
  }
  // Builds, and checks the file.
  BuildSummary mustBuild(const support::Mesh& mesh, const BuildOptions& options,
                         const glm::dvec3& offset = glm::dvec3(0.0)) {
    const auto summary = build(mesh, options, offset);
    EXPECT_TRUE(summary) << summary.error().message;
    if (!summary) return {};
    auto file = base::PositionedFile::open(path());
    EXPECT_TRUE(file);
    for (const std::string& fault : checkFile(lod::DiskBytes(std::move(*file)))) ADD_FAILURE() << fault;
    return *summary;
  }

  struct Whole {
    base::Bytes bytes;
    Header header;
    std::vector<Node> nodes;

    NodeGeometry picture(const Node& node) const {
      auto decoded = decodeBlock(base::ByteView(bytes).subspan(node.picture.offset, node.picture.bytes), node,
                                 {header.colors, false});
      EXPECT_TRUE(decoded) << decoded.error().message;
      return decoded ? std::move(*decoded) : NodeGeometry();
    }
    NodeGeometry caster(const Node& node) const {
      auto decoded = decodeBlock(base::ByteView(bytes).subspan(node.caster.offset, node.caster.bytes), node,
                                 {header.colors, true});
      EXPECT_TRUE(decoded) << decoded.error().message;
      return decoded ? std::move(*decoded) : NodeGeometry();
    }
    /// Adds the geometry's triangles, scene-local.
    void add(const NodeGeometry& geometry, const Node& node, support::Surface& surface) const {
      const auto first = static_cast<std::uint32_t>(surface.positions.size());
      for (const NodeVertex& v : geometry.vertices)
        surface.positions.push_back(header.lattice.position(v.place << int{node.step_bits}));
      for (const std::uint32_t i : geometry.triangles) surface.indices.push_back(first + i);
    }
    /// All nodes of a depth, and the leaves above it.
    std::vector<std::uint32_t> cutAt(std::uint32_t depth) const {
      std::vector<std::uint32_t> cut{0};
      for (std::uint32_t d = 0; d < depth; ++d) {
        std::vector<std::uint32_t> finer;
        for (const std::uint32_t n : cut) {
          if (nodes[n].isLeaf()) finer.push_back(n);
          for (std::uint32_t k = 0; k < nodes[n].children; ++k) finer.push_back(nodes[n].first_child + k);
        }
        cut = finer;
      }
      return cut;
    }
  };
  Whole whole() const {
    Whole out;
    out.bytes = *base::readFile(path());
    out.header = *readHeader(out.bytes);
    out.nodes = *readTable(out.header, base::ByteView(out.bytes).subspan(kHeaderBytes, out.header.table_bytes));
    return out;
  }
  static BuildOptions small() {
    BuildOptions options;
    options.leaf_triangles = 600;
    options.resolution = 64.0F;
    return options;
  }

  support::TemporaryDirectory directory_;
};

support::Surface sourceOf(const support::Mesh& mesh, const BuildSummary& summary,
                          const glm::dvec3& offset = glm::dvec3(0.0)) {
  support::Surface surface;
  for (const glm::vec3& p : mesh.positions)
    surface.positions.push_back(glm::vec3(glm::dvec3(p) + offset - summary.origin));
  surface.indices = mesh.indices;
  return surface;
}

TEST_F(HlodBuild, leavesHoldTheSource) {
  const support::Mesh mesh = support::bumpySphere(80, 160);
  const BuildSummary summary = mustBuild(mesh, small());
  EXPECT_EQ(summary.triangles, mesh.indices.size() / 3);
  const Whole file = whole();
  support::Surface leaves;
  std::uint64_t triangles = 0;
  for (const Node& node : file.nodes) {
    if (!node.isLeaf()) continue;
    EXPECT_EQ(node.error, 0.0F);
    EXPECT_LE(node.triangles, 600U);
    triangles += node.triangles;
    file.add(file.picture(node), node, leaves);
  }
  EXPECT_EQ(triangles, summary.triangles);
  const double step = file.header.lattice.positionError();
  const support::Surface source = sourceOf(mesh, summary);
  EXPECT_LE(support::sampledDistance(source, support::NearestSurface(leaves), 20000).max, 1.01 * step);
  EXPECT_LE(support::sampledDistance(leaves, support::NearestSurface(source), 20000).max, 1.01 * step);
}

// At every level the triangles, were none replaced by points, and the casters are as near as the file states.
TEST_F(HlodBuild, statedDistancesHoldAtEveryLevel) {
  for (const support::Mesh& mesh : {support::torus(300, 100), support::openGrid(200, 0.1F), support::plant()}) {
    BuildOptions options = small();
    options.points = false;
    const BuildSummary summary = mustBuild(mesh, options);
    const Whole file = whole();
    ASSERT_GE(summary.levels.size(), 3U);
    const support::Surface source = sourceOf(mesh, summary);
    const support::NearestSurface to_source(source);
    for (std::uint32_t depth = 0; depth + 1 < summary.levels.size(); ++depth) {
      support::Surface pictures, casters;
      float shape = 0.0F, error = 0.0F, caster = 0.0F;
      for (const std::uint32_t n : file.cutAt(depth)) {
        const Node& node = file.nodes[n];
        file.add(file.picture(node), node, pictures);
        file.add(node.isLeaf() ? file.picture(node) : file.caster(node), node, casters);
        shape = std::max(shape, node.shape_error);
        error = std::max(error, node.error);
        caster = std::max(caster, node.caster_error);
      }
      const double lattice = 1.01 * file.header.lattice.positionError();
      const support::NearestSurface to_pictures(pictures), to_casters(casters);
      constexpr std::size_t kSamples = 20000;
      for (const float bound : {shape, error}) {
        EXPECT_LE(support::sampledDistance(source, to_pictures, kSamples).max, static_cast<double>(bound) + lattice);
        EXPECT_LE(support::sampledDistance(pictures, to_source, kSamples).max, static_cast<double>(bound) + lattice);
      }
      EXPECT_LE(support::sampledDistance(source, to_casters, kSamples).max, static_cast<double>(caster) + lattice);
      EXPECT_LE(support::sampledDistance(casters, to_source, kSamples).max, static_cast<double>(caster) + lattice);
    }
  }
}

TEST_F(HlodBuild, errorsAreNotFarAboveTheCellsShare) {
  const BuildSummary summary = mustBuild(support::torus(300, 100), small());
  const Whole file = whole();
  const float edge = static_cast<float>(file.header.lattice.step) * 65536.0F;  // at most the lattice's size
  float largest = 0.0F;
  for (const Node& node : file.nodes) largest = std::max(largest, node.error);
  EXPECT_GT(largest, 0.0F);
  EXPECT_LE(file.nodes[0].error, 1.5F * edge / 64.0F);
  EXPECT_LT(file.nodes[0].triangles + file.nodes[0].points, summary.triangles / 4);
}

TEST_F(HlodBuild, threadsDoNotChangeTheBytes) {
  const support::Mesh mesh = support::torus(300, 100);
  base::Bytes first;
  for (const unsigned threads : {1U, 4U}) {
    BuildOptions options = small();
    options.limits.threads = threads;
    mustBuild(mesh, options);
    const auto bytes = *base::readFile(path());
    if (first.empty()) first = bytes;
    EXPECT_TRUE(bytes == first);
  }
}

TEST_F(HlodBuild, surveyCoordinatesKeepTheirMillimetres) {
  const support::Mesh mesh = support::openGrid(100, 0.1F);
  const glm::dvec3 offset(4.5e6, 5.2e6, 800.0);
  const BuildSummary summary = mustBuild(mesh, small(), offset);
  const Whole file = whole();
  support::Surface leaves;
  for (const Node& node : file.nodes)
    if (node.isLeaf()) file.add(file.picture(node), node, leaves);
  const support::Surface source = sourceOf(mesh, summary, offset);
  EXPECT_LE(support::sampledDistance(source, support::NearestSurface(leaves), 20000).max, 1e-3);
}

// A part of a refinery. Stitching splits an edge of one triangle by a vertex that another one, between the same ends,
// has for its third corner.
TEST_F(HlodBuild, aTriangleThatFillsTheGapBesideASplitEdgeStays) {
  support::Mesh mesh;
  mesh.positions = {{152.874054F, -266.108917F, 4.95627737F}, {194.174225F, -305.748108F, 4.80697727F},
                    {195.489929F, -305.748108F, 4.76032114F}, {194.836731F, -305.748108F, 4.78831482F},
                    {152.874054F, -259.586365F, 4.76032114F}, {195.489929F, -305.748108F, 4.3590765F},
                    {205.238586F, -316.289368F, 4.75847912F}, {195.495514F, -305.748108F, 4.75847912F},
                    {194.165192F, -305.748108F, 4.80915833F}};
  mesh.indices = {6, 7, 8, 2, 1, 3, 0, 1, 2, 4, 2, 5};
  const BuildSummary summary = mustBuild(mesh, small());
  EXPECT_GT(summary.repairs.counts.at("split_border_edges"), 0U);
  EXPECT_EQ(summary.header.source_triangles, summary.triangles);
  EXPECT_FALSE(summary.repairs.counts.contains("lattice_collapsed_triangles"));
}

TEST_F(HlodBuild, finerLatticesAreAskedFor) {
  BuildOptions options = small();
  options.position_bits = 18;
  const BuildSummary summary = mustBuild(support::bumpySphere(20, 40), options);
  const glm::dvec3 size = summary.box_max - summary.box_min;
  const double longest = std::max({size.x, size.y, size.z});
  EXPECT_NEAR(summary.header.lattice.step, longest / (1 << 18), 1e-4 * summary.header.lattice.step);
}

TEST_F(HlodBuild, oneTriangleIsAScene) {
  support::Mesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.indices = {0, 1, 2};
  const BuildSummary summary = mustBuild(mesh, {});
  EXPECT_EQ(summary.header.nodes, 1U);
  EXPECT_EQ(whole().nodes[0].triangles, 1U);
}

// Triangles that share their median vertex along the Morton curve lie in one cell at every depth.
TEST_F(HlodBuild, manyTrianglesInOnePlaceAreALeaf) {
  constexpr std::uint32_t kTriangles = 500;
  support::Mesh mesh;
  mesh.positions.emplace_back(0.0F);
  for (std::uint32_t i = 0; i < kTriangles; ++i) {
    const float turn = 0.003F * static_cast<float>(i);
    const glm::vec3 away(0.5F + 0.4F * std::cos(turn), 0.5F + 0.4F * std::sin(turn), 0.2F + 0.001F * turn);
    mesh.positions.push_back(-away);
    mesh.positions.emplace_back(away.y, away.x, away.z + 0.3F);
    support::addTriangle(mesh, 2 * i + 1, 0, 2 * i + 2);
  }
  BuildOptions options = small();
  options.leaf_triangles = 20;
  mustBuild(mesh, options);
  std::uint32_t largest = 0;
  for (const Node& node : whole().nodes)
    if (node.isLeaf()) largest = std::max(largest, node.triangles);
  EXPECT_GT(largest, options.leaf_triangles);
}

/// Triangles that hang together with no others, all over a cube.
support::Mesh soup(std::uint32_t triangles, float size) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> in(0.0F, 1.0F), out(-size, size);
  support::Mesh mesh;
  for (std::uint32_t t = 0; t < triangles; ++t) {
    const glm::vec3 at(in(random), in(random), in(random));
    for (int k = 0; k < 3; ++k) mesh.positions.push_back(at + glm::vec3(out(random), out(random), out(random)));
    support::addTriangle(mesh, 3 * t, 3 * t + 1, 3 * t + 2);
  }
  return mesh;
}

// No collapse can take such a triangle away. Where they are far smaller than the error they are points, so that
// nodes above need no memory for all of them.
TEST_F(HlodBuild, soupFitsASmallMemory) {
  constexpr std::uint32_t kTriangles = 200'000;
  const support::Mesh mesh = soup(kTriangles, 0.0008F);
  BuildOptions options = small();
  options.limits.memory_bytes = std::uint64_t{320} << 20;
  const BuildSummary summary = mustBuild(mesh, options);
  EXPECT_GT(summary.triangles, kTriangles - kTriangles / 1000);  // some have no area on the lattice
  const Whole file = whole();
  const Node& root = file.nodes[0];
  EXPECT_LT(root.triangles, kTriangles / 100);
  ASSERT_GT(root.points, 0U);
  EXPECT_GT(root.caster_triangles, 0U);
  // All is found again within the root's error.
  const NodeGeometry picture = file.picture(root);
  std::vector<glm::vec3> places;
  for (const auto* list : {&picture.points, &picture.vertices})
    for (const NodeVertex& vertex : *list)
      places.push_back(file.header.lattice.position(vertex.place << int{root.step_bits}));
  const support::Surface source = sourceOf(mesh, summary);
  float farthest = 0.0F;
  for (std::size_t v = 0; v < source.positions.size(); v += 1511) {
    float least = 1e30F;
    for (const glm::vec3& place : places) least = std::min(least, glm::distance(place, source.positions[v]));
    farthest = std::max(farthest, least);
  }
  EXPECT_LE(farthest, root.error);
  EXPECT_LE(root.error, 1.1F / 64.0F);
}

TEST_F(HlodBuild, wrongOptionsAreNamed) {
  BuildOptions options;
  options.leaf_triangles = 0;
  EXPECT_EQ(build(support::openGrid(4), options).error().code, base::ErrorCode::kInvalidInput);
  options = {};
  options.resolution = 1.0F;
  EXPECT_EQ(build(support::openGrid(4), options).error().code, base::ErrorCode::kInvalidInput);
}

}  // namespace
