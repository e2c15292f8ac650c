// Built files are valid, have the paper's bytes per leaf, and do not depend on threads and memory. Bad meshes are
// refused.
#include "lod/qsplat/builder/build.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "lod/qsplat/blocks.h"
#include "lod/qsplat/builder/file_build.h"
#include "lod/qsplat/splat_file.h"
#include "mesh/generate/sample.h"
#include "tests/support/built_splats.h"
#include "tests/support/coded_splats.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/random_splats.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::ingest;
using namespace lod::qsplat::builder;
using namespace mesh::generate;
using lod::qsplat::SplatFile;
using support::makeSample;
using support::Mesh;
using support::PlyMesh;

class QsplatBuild : public testing::Test {
 protected:
  std::string path() const { return directory_ / "out.lgq"; }

  // Builds a valid file, and no work file is left.
  BuildSummary mustBuild(const Mesh& mesh, const BuildOptions& options = {}) {
    auto summary = support::buildSplats(mesh, options, path());
    EXPECT_TRUE(summary) << summary.error().message;
    if (!summary) return {};
    expectSound(*summary);
    return std::move(*summary);
  }
  BuildSummary mustBuild(const PlyMesh& mesh, double dice = kDefaultDice) {
    writePly(directory_ / "mesh.ply", mesh);
    BuildOptions options;
    options.dice = dice;
    auto summary = buildFromFiles({directory_ / "mesh.ply"}, options, path());
    EXPECT_TRUE(summary) << summary.error().message;
    if (!summary) return {};
    expectSound(*summary);
    return std::move(*summary);
  }
  // The error is one line, and no file is left.
  void mustRefuse(const PlyMesh& mesh, const std::string& what) {
    writePly(directory_ / "mesh.ply", mesh);
    const auto summary = buildFromFiles({directory_ / "mesh.ply"}, {}, path());
    ASSERT_FALSE(summary);
    EXPECT_NE(summary.error().message.find(what), std::string::npos) << summary.error().message;
    EXPECT_EQ(summary.error().message.find('\n'), std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(path()));
    EXPECT_FALSE(std::filesystem::exists(path() + ".work"));
  }
  void expectSound(const BuildSummary& summary) {
    const auto file = SplatFile::open(path());
    ASSERT_TRUE(file) << file.error().message;
    EXPECT_EQ(file->verify(), std::vector<std::string>());
    EXPECT_EQ(file->header().leaves, summary.header.leaves);
    EXPECT_FALSE(std::filesystem::exists(path() + ".work"));
  }
  std::vector<support::DecodedNode> nodes() const { return support::decodeSplats(bytes()); }
  base::Bytes bytes() const { return *base::readFile(path()); }

  support::TemporaryDirectory directory_;
};

// Every point of every triangle lies in some leaf's sphere.
TEST_F(QsplatBuild, leavesCoverTheSurface) {
  for (const Mesh& mesh : {support::bumpySphere(20, 30), support::torus(30, 16), support::openGrid(16),
                           support::triangleSoup(60, 0.2F), support::tinyComponents(30)}) {
    const glm::vec3 origin(mustBuild(mesh).origin);
    const auto all = nodes();
    std::size_t uncovered = 0;
    for (std::size_t t = 0; t < mesh.indices.size(); t += 3)
      for (int i = 0; i <= 4; ++i)
        for (int j = 0; i + j <= 4; ++j) {
          const float u = static_cast<float>(i) / 4.0F, v = static_cast<float>(j) / 4.0F;
          const glm::vec3 p = (1.0F - u - v) * mesh.positions[mesh.indices[t]] +
                              u * mesh.positions[mesh.indices[t + 1]] + v * mesh.positions[mesh.indices[t + 2]];
          // The lattice moves vertices by a sixteenth of an edge at most.
          const bool covered = std::any_of(all.begin(), all.end(), [&](const support::DecodedNode& node) {
            return node.leaf && glm::distance(origin + node.sphere.center, p) <= node.sphere.radius * 1.07F;
          });
          uncovered += covered ? 0 : 1;
        }
    EXPECT_EQ(uncovered, 0U);
  }
}

TEST_F(QsplatBuild, bytesPerLeafAreThePapers) {
  SampleOptions sample;
  sample.triangles = 200000;
  Mesh mesh = makeSample(sample);
  const auto share = [](const lod::qsplat::Header& h) {
    return static_cast<double>(h.pointers * h.pointerBytes()) / static_cast<double>(h.file_bytes);
  };
  const auto perLeaf = [](const lod::qsplat::Header& h) {
    return static_cast<double>(h.file_bytes) / static_cast<double>(h.leaves);
  };
  const lod::qsplat::Header colored = mustBuild(mesh).header;
  mesh.colors.clear();
  const lod::qsplat::Header plain = mustBuild(mesh).header;
  std::printf("%.2f and %.2f bytes a leaf, pointers %.3f and %.3f\n", perLeaf(colored), perLeaf(plain), share(colored),
              share(plain));
  EXPECT_NEAR(perLeaf(colored), 9.0, 0.3);
  EXPECT_NEAR(perLeaf(plain), 6.0, 0.3);
  EXPECT_LT(share(plain), 0.1);
  EXPECT_LT(share(colored), 0.1);
}

TEST_F(QsplatBuild, threadsAndMemoryDoNotChangeTheBytes) {
  SampleOptions sample;
  sample.triangles = 700000;  // several buckets
  const Mesh mesh = makeSample(sample);
  base::Bytes first;
  for (const auto& [threads, memory] : {std::pair{1U, 256U}, std::pair{2U, 4096U}, std::pair{5U, 300U}}) {
    BuildOptions options;
    options.limits.threads = threads;
    options.limits.memory_bytes = std::uint64_t{memory} << 20;
    mustBuild(mesh, options);
    if (first.empty()) first = bytes();
    EXPECT_TRUE(bytes() == first) << threads << " threads, " << memory << " MB";
  }
}

TEST_F(QsplatBuild, theCodedFormHoldsThePlainFilesNodes) {
  SampleOptions sample;
  sample.triangles = 100000;
  const Mesh mesh = makeSample(sample);
  mustBuild(mesh);
  const base::Bytes plain = bytes();
  base::Bytes first;
  for (const auto& [threads, memory] : {std::pair{1U, 256U}, std::pair{3U, 1024U}}) {
    BuildOptions options;
    options.limits.threads = threads;
    options.limits.memory_bytes = std::uint64_t{memory} << 20;
    options.coded = true;
    const BuildSummary summary = mustBuild(mesh, options);
    EXPECT_EQ(summary.bytes, bytes().size());
    EXPECT_LT(summary.bytes, plain.size() * 6 / 10);
    if (first.empty()) first = bytes();
    EXPECT_TRUE(bytes() == first) << threads << " threads, " << memory << " MB";
  }
  ASSERT_EQ(lod::qsplat::readHeader(first)->file_bytes, plain.size());
  const auto nodes = support::decodeSplats(plain);
  const auto coded = support::decodeSplats(support::plainSplats(first));
  ASSERT_EQ(coded.size(), nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    // In the coded form the cones of leaves have every fourth width.
    const std::uint32_t coarse = nodes[i].among_leaves ? 3U << 27 : 0U;
    ASSERT_EQ(coded[i].node.bits, nodes[i].node.bits | coarse) << i;
    ASSERT_EQ(coded[i].node.color, nodes[i].node.color) << i;
  }
}

TEST_F(QsplatBuild, widePointersMakeTheSameTree) {
  const Mesh mesh = support::torus(60, 30);
  mustBuild(mesh);
  const auto narrow = nodes();
  const std::string store_path = directory_ / "nodes";
  auto store = SubtreeStore::open(store_path, false, 3);
  ASSERT_TRUE(store);
  // The same leaves come from three tiles, one of which is empty and one has a single leaf.
  std::vector<Splat> leaves;
  for (const support::DecodedNode& node : narrow) {
    if (!node.leaf) continue;
    Splat leaf;
    leaf.sphere = node.sphere;
    leaf.weight = 1.0F;
    leaf.normal = lod::qsplat::normalTable()[node.node.normalCode()];
    leaf.direction = node.node.normalCode();
    leaves.push_back(leaf);
  }
  ASSERT_TRUE(store->add(1, makeSubtree(std::span(leaves).subspan(1))));
  ASSERT_TRUE(store->add(0, Subtree()));
  ASSERT_TRUE(store->add(2, makeSubtree(std::span(leaves).first(1))));
  std::vector<support::DecodedNode> trees[2];
  for (const bool wide : {false, true}) {
    FileBuildOptions options;
    options.wide_pointers = wide;
    options.runs_path = directory_ / "runs";
    const auto written = writeTree(*store, path(), options);
    ASSERT_TRUE(written) << written.error().message;
    EXPECT_EQ(written->header.wide_pointers, wide);
    EXPECT_EQ(written->header.leaves, leaves.size());
    EXPECT_EQ(lod::qsplat::checkTree(bytes()), std::vector<std::string>());
    trees[wide ? 1 : 0] = nodes();
  }
  ASSERT_EQ(trees[0].size(), trees[1].size());
  for (std::size_t i = 0; i < trees[0].size(); ++i) EXPECT_EQ(trees[0][i].node.bits, trees[1][i].node.bits);
}

TEST_F(QsplatBuild, aStoreContinuesBehindItsLastCompleteRecord) {
  const std::string store_path = directory_ / "nodes";
  std::vector<Splat> leaves(10);
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    leaves[i].sphere = {glm::vec3(static_cast<float>(i), 0.0F, 0.0F), 0.6F};
    leaves[i].weight = 1.0F;
  }
  std::uint64_t whole = 0;
  {
    auto store = SubtreeStore::open(store_path, false, 2);
    ASSERT_TRUE(store->add(0, makeSubtree(leaves)));
    whole = store->bytes();
    ASSERT_TRUE(store->add(1, makeSubtree(leaves)));
  }
  const base::Bytes both = *base::readFile(store_path);
  for (std::uint64_t cut = whole; cut < both.size(); cut += 13) {
    ASSERT_TRUE(base::writeFileAtomically(store_path, base::ByteView(both).first(cut)));
    auto store = SubtreeStore::open(store_path, true, 2);
    ASSERT_TRUE(store);
    EXPECT_TRUE(store->has(0));
    EXPECT_FALSE(store->has(1));
    ASSERT_TRUE(store->add(1, makeSubtree(leaves)));
    EXPECT_EQ(store->bytes(), both.size());
  }
}

TEST_F(QsplatBuild, surveyCoordinatesKeepTheirMillimeters) {
  const glm::dvec3 utm(499000.0, 6782000.0, 300.0);
  const PlyMesh here(support::torus(40, 20), 1.0);
  const PlyMesh there(support::torus(40, 20), 1.0, utm);
  mustBuild(here);
  const auto near = nodes();
  const auto summary = mustBuild(there);
  const auto far = nodes();
  EXPECT_LT(glm::distance(summary.origin, utm), 2.0);
  ASSERT_EQ(near.size(), far.size());
  const glm::dvec3 shift = utm - summary.origin;
  EXPECT_NEAR(glm::distance(glm::dvec3(near[0].sphere.center) + shift, glm::dvec3(far[0].sphere.center)), 0.0, 1e-4);
}

TEST_F(QsplatBuild, twoTrianglesMakeATree) {
  PlyMesh mesh;
  for (const glm::dvec3& p : {glm::dvec3(0), glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(1, 1, 0.1)})
    mesh.add(p);
  mesh.add(0, 1, 2), mesh.add(1, 3, 2);
  const auto summary = mustBuild(mesh, 0.0);
  EXPECT_EQ(summary.header.leaves, 4U);
  EXPECT_EQ(summary.header.nodes, 5U);
  EXPECT_EQ(summary.triangles, 2U);
  EXPECT_GT(summary.facing.z, 0.0);
}

TEST_F(QsplatBuild, refusesCoordinatesThatAreNotFinite) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e30}) {
    PlyMesh mesh(support::torus(10, 8));
    mesh.positions[7].y = bad;
    mustRefuse(mesh, "vertex 7");
  }
}

TEST_F(QsplatBuild, refusesMeshesWithoutExtent) {
  PlyMesh same(support::torus(10, 8));
  for (glm::dvec3& p : same.positions) p = glm::dvec3(3.0, 4.0, 5.0);
  mustRefuse(same, "no triangle");
  mustRefuse(PlyMesh(support::torus(10, 8), 1e-30), "too small");
  PlyMesh none;
  none.add(glm::dvec3(0.0));
  EXPECT_EQ(mustBuild(none).header.leaves, 1U);  // a point cloud of one
}

TEST_F(QsplatBuild, theScaleOfTheMeshDoesNotMatter) {
  mustBuild(PlyMesh(support::torus(20, 12)), 0.0);
  const auto one = nodes();
  for (const double scale : {1e-14, 1e-6, 1e6, 1e14}) {
    mustBuild(PlyMesh(support::torus(20, 12), scale), 0.0);
    const auto scaled = nodes();
    EXPECT_NEAR(static_cast<double>(scaled[0].sphere.radius) / scale, static_cast<double>(one[0].sphere.radius), 1e-3);
    EXPECT_NEAR(static_cast<double>(scaled.size()), static_cast<double>(one.size()), 8.0);
  }
}

TEST_F(QsplatBuild, countsDuplicatesAndStrayVertices) {
  PlyMesh mesh(support::torus(20, 12));
  const auto vertices = static_cast<std::uint32_t>(mesh.positions.size());
  // Each vertex has a copy, each triangle is repeated over the copies, and some vertices are unused.
  for (std::uint32_t v = 0; v < vertices; ++v) mesh.add(mesh.positions[v]);
  for (std::size_t i = 0, all = mesh.indices.size(); i < all; i += 3)
    mesh.add(mesh.indices[i] + vertices, mesh.indices[i + 1] + vertices, mesh.indices[i + 2] + vertices);
  mesh.add(glm::dvec3(100.0)), mesh.add(glm::dvec3(-100.0));
  mesh.add(3, 3, 4);
  const auto summary = mustBuild(mesh);
  EXPECT_EQ(summary.header.leaves - summary.added_leaves, vertices);
  EXPECT_EQ(summary.repairs.counts.at("welded_vertices"), vertices);
  EXPECT_EQ(summary.repairs.counts.at("unreferenced_vertices"), 2U);
  EXPECT_EQ(summary.repairs.counts.at("degenerate_triangles"), 1U);
  EXPECT_LT(nodes()[0].sphere.radius, 3.0F);
}

TEST_F(QsplatBuild, aGiantTriangleIsDicedOrMakesLargeLeaves) {
  PlyMesh mesh(support::bumpySphere(30, 40));
  const std::uint32_t a = mesh.add({-500, 0, 0}), b = mesh.add({500, 0, 0}), c = mesh.add({0, 900, 0});
  mesh.add(a, b, c);
  const auto giants = [this](float radius) {
    const auto all = nodes();
    return std::count_if(all.begin(), all.end(),
                         [&](const auto& node) { return node.leaf && node.sphere.radius > radius; });
  };
  const auto whole = mustBuild(mesh, 0.0);
  EXPECT_EQ(giants(400.0F), 3);
  EXPECT_EQ(whole.added_leaves, 0U);
  EXPECT_LE(whole.header.levels, 40U);
  const auto diced = mustBuild(mesh);
  EXPECT_EQ(giants(20.0F), 0);
  EXPECT_GT(diced.added_leaves, 5'000U);
  EXPECT_EQ(diced.header.leaves, whole.header.leaves + diced.added_leaves);
  EXPECT_LE(diced.header.levels, 40U);
}

TEST_F(QsplatBuild, cancellingLeavesNoFile) {
  for (const std::string stage : {"import", "sort", "tree", "encode", "write"}) {
    const auto summary = support::buildSplats(support::torus(40, 20), {}, path(),
                                              [&](const std::string& now, double) { return now != stage; });
    ASSERT_FALSE(summary) << stage;
    EXPECT_EQ(summary.error().code, base::ErrorCode::kCancelled) << stage;
    EXPECT_FALSE(std::filesystem::exists(path()));
  }
}

TEST_F(QsplatBuild, refusesTooLittleMemory) {
  BuildOptions options;
  options.limits.memory_bytes = 1 << 20;
  const auto summary = support::buildSplats(support::torus(40, 20), options, path());
  ASSERT_FALSE(summary);
  EXPECT_EQ(summary.error().code, base::ErrorCode::kNoSpace);
}

}  // namespace
