// Points far from a cloud are drawn small, wherever they are, and nodes above them enclose them.
#include <gtest/gtest.h>

#include <algorithm>
#include <glm/gtc/matrix_transform.hpp>
#include <random>

#include "lod/qsplat/builder/build.h"
#include "lod/qsplat/builder/editable_tree.h"
#include "lod/qsplat/builder/lone_leaves.h"
#include "lod/qsplat/splat_file.h"
#include "lod/qsplat/traverse.h"
#include "tests/support/ply_file.h"
#include "tests/support/random_splats.h"
#include "tests/support/temporary_directory.h"

namespace {

using namespace lod::qsplat::builder;
using lod::qsplat::encloses;
using lod::qsplat::Node;
using support::DecodedNode;

constexpr int kSide = 100;  // points of the ground, one unit apart

std::vector<glm::dvec3> ground() {
  std::vector<glm::dvec3> points;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) points.emplace_back(x, y, 2.0 * std::sin(0.1 * x));
  return points;
}

struct Built {
  BuildSummary summary;
  base::Bytes bytes;
  std::vector<DecodedNode> leaves;

  float largest() const {
    float radius = 0.0F;
    for (const DecodedNode& leaf : leaves) radius = std::max(radius, leaf.sphere.radius);
    return radius;
  }
  bool covers(const glm::vec3& place) const {
    return std::any_of(leaves.begin(), leaves.end(), [&](const DecodedNode& leaf) {
      return glm::distance(leaf.sphere.center, place) <= leaf.sphere.radius + 1e-3F;
    });
  }
};

Built build(const std::vector<glm::dvec3>& points, bool coded = false) {
  const support::TemporaryDirectory directory;
  support::PlyMesh ply;
  ply.positions = points;
  writePly(directory / "points.ply", ply);
  BuildOptions options;
  options.coded = coded;
  const auto summary = buildFromFiles({directory / "points.ply"}, options, directory / "out.lgq");
  EXPECT_TRUE(summary) << summary.error().message;
  Built out;
  if (!summary) return out;
  const auto file = lod::qsplat::SplatFile::open(directory / "out.lgq");
  EXPECT_TRUE(file);
  EXPECT_EQ(file->verify(), std::vector<std::string>());
  out.summary = *summary;
  out.bytes = *base::readFile(directory / "out.lgq");
  if (coded) return out;
  for (const DecodedNode& node : support::decodeSplats(out.bytes))
    if (node.leaf) out.leaves.push_back(node);
  return out;
}

/// Strays around the ground, by name.
struct Strays {
  const char* name;
  std::vector<glm::dvec3> points;
};

const std::vector<Strays>& allStrays() {
  static const std::vector<Strays> all{
      {"straight above the middle", {{49.5, 49.5, 5000.0}}},
      {"straight below a corner", {{0.0, 0.0, -5000.0}}},
      {"aside", {{-5000.0, 49.5, 0.0}}},
      {"askew", {{3000.0, -2500.0, 700.0}}},
      {"a small group", {{50, 50, 1000}, {51, 50, 1000.5}, {50, 51, 1001}, {51, 51, 1000}, {50.5, 50.5, 1000.5}}},
      {"of several distances", {{20, 30, 40}, {70, 30, 200}, {30, 80, 900}, {60, 60, 4000}, {300, 0, 20000}}},
  };
  return all;
}

TEST(LoneLeaves, straysAreDrawnAboutAsSmallAsTheGround) {
  const Built clean = build(ground());
  EXPECT_EQ(clean.summary.added_leaves, 0U);
  const float usual = clean.largest();
  EXPECT_LT(usual, 3.0F);
  for (const Strays& strays : allStrays()) {
    auto points = ground();
    points.insert(points.end(), strays.points.begin(), strays.points.end());
    const Built built = build(points);
    EXPECT_LT(built.largest(), 3.5F * usual) << strays.name;
    EXPECT_EQ(built.leaves.size(), points.size() + built.summary.added_leaves) << strays.name;
    EXPECT_GT(built.summary.added_leaves, 0U) << strays.name;
    EXPECT_LE(built.summary.added_leaves, 40U * strays.points.size()) << strays.name;
    const glm::dvec3 origin = built.summary.origin;
    for (const glm::dvec3& p : strays.points) EXPECT_TRUE(built.covers(glm::vec3(p - origin))) << strays.name;
  }
}

// A ball 5 km above and kilometres wide was all of the first picture's background.
TEST(LoneLeaves, theBackgroundStaysBackground) {
  auto points = ground();
  for (const Strays& strays : allStrays()) points.insert(points.end(), strays.points.begin(), strays.points.end());
  const Built built = build(points);
  const auto header = *lod::qsplat::readHeader(built.bytes);
  const auto blocks = lod::qsplat::openBlocks(built.bytes, header);
  ASSERT_TRUE(blocks);
  const glm::vec3 middle(glm::dvec3(49.5, 49.5, 0.0) - built.summary.origin);
  lod::qsplat::TraverseRequest request;
  request.cull_back_faces = false;
  request.camera.width = 960;
  request.camera.height = 540;
  for (const glm::vec3& away : {glm::vec3(-120, -90, 80), glm::vec3(130, 60, 150), glm::vec3(0, -150, 30)}) {
    request.camera.eye = middle + away;
    request.camera.eye_from_scene = glm::lookAt(middle + away, middle, glm::vec3(0.0F, 0.0F, 1.0F));
    request.camera.clip_from_eye = glm::perspective(0.8F, 960.0F / 540.0F, 1.0F, 50'000.0F);
    const auto seen = lod::qsplat::traverse(**blocks, request);
    double strays = 0.0;  // pixels
    for (const auto& splat : seen.splats) {
      const glm::vec3 off = splat.center - middle;
      if (glm::length(off) < 80.0F) continue;  // the ground
      const float size = 2.0F * splat.radius * request.camera.pixelsPerUnitAtOne() /
                         std::max(1.0F, glm::distance(splat.center, middle + away));
      strays += static_cast<double>(size * size);
    }
    EXPECT_LT(strays, 0.01 * 960.0 * 540.0);
  }
}

TEST(LoneLeaves, theCodedFormTakesRepeatedLeaves) {
  auto points = ground();
  points.emplace_back(49.5, 49.5, 5000.0);
  const Built built = build(points, true);
  EXPECT_TRUE(built.summary.header.coded());
  EXPECT_GT(built.summary.added_leaves, 0U);
}

// ---- the steps by themselves ----

Splat leafAt(const glm::vec3& at, float radius) {
  Splat leaf;
  leaf.sphere = {at, radius};
  leaf.normal = {0.0F, 0.0F, 1.0F};
  leaf.weight = 1.0F;
  leaf.direction = lod::qsplat::encodeNormal(leaf.normal);
  leaf.least_cosine = 0.9F;
  return leaf;
}

std::vector<TreeNode> sheetWith(const glm::vec3& stray) {
  std::vector<Splat> leaves;
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 32; ++x) leaves.push_back(leafAt({static_cast<float>(x), static_cast<float>(y), 0.0F}, 0.7F));
  leaves.push_back(leafAt(stray, 0.7F));
  return makeSubtree(leaves).nodes;
}

std::vector<LargeLeaf> largeLeaves(const std::vector<TreeNode>& nodes) {
  std::vector<LargeLeaf> large;
  const float usual = usualRadius(nodes);
  encodeSubtree(nodes, nodes[0].sphere, false, LeafCones::kEach,
                [&](std::uint32_t leaf, float radius, const base::Sphere& parent) {
                  if (isTooLarge(radius, nodes[leaf].sphere.radius, usual)) large.push_back({leaf, parent, radius});
                });
  return large;
}

TEST(LoneLeaves, nodesEncloseTheirChildrenWhateverWasWidenedOrRepeated) {
  for (const glm::vec3& stray : {glm::vec3(15.5F, 15.5F, 900.0F), glm::vec3(800.0F, 15.5F, 0.0F)}) {
    std::vector<TreeNode> nodes = sheetWith(stray);
    const float before = nodes[0].sphere.radius;
    EXPECT_TRUE(widenAroundLone(nodes));
    EXPECT_GT(nodes[0].sphere.radius, before);
    EXPECT_LT(nodes[0].sphere.radius, 1.3F * before);
    const float usual = usualRadius(nodes);
    const std::size_t all = nodes.size();
    const auto large = largeLeaves(nodes);
    ASSERT_FALSE(large.empty());
    const NestedLeaves nested = nestLargeLeaves(std::move(nodes), large, usual);
    EXPECT_EQ(nested.nodes.size(), all + 2 * nested.added_leaves);
    EXPECT_TRUE(largeLeaves(nested.nodes).empty());
    const EditableTree tree(nested.nodes);
    for (const std::uint32_t number : tree.order(tree.root()))
      if (number != tree.root()) {
        EXPECT_TRUE(encloses(tree.node(tree.parent(number)).sphere, tree.node(number).sphere));
      }
  }
}

TEST(LoneLeaves, aSheetAloneStaysAsItIs) {
  std::vector<TreeNode> nodes = sheetWith({32.0F, 0.0F, 0.0F});
  EXPECT_FALSE(widenAroundLone(nodes));
  EXPECT_TRUE(largeLeaves(nodes).empty());
}

// Noise all over the sky may not take more room than a part of the cloud.
TEST(LoneLeaves, repeatedLeavesAreLimited) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> unit(-1.0F, 1.0F);
  std::vector<Splat> leaves;
  for (int i = 0; i < 3000; ++i)
    leaves.push_back(leafAt(10'000.0F * glm::vec3(unit(random), unit(random), unit(random)), 0.5F));
  const std::vector<TreeNode> nodes = makeSubtree(leaves).nodes;
  const auto large = largeLeaves(nodes);
  EXPECT_GT(large.size(), 1500U);
  const NestedLeaves nested = nestLargeLeaves(nodes, large, usualRadius(nodes));
  EXPECT_GT(nested.added_leaves, 500U);
  EXPECT_LE(nested.added_leaves, 1024U);
}

}  // namespace
