#include "server/cli/streamed/hull.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "base/file.h"
#include "tests/support/made_hlod.h"
#include "tests/support/made_pmr.h"
#include "tests/support/splat_tree.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace server::cli {
namespace {

using Points = std::vector<glm::vec3>;

class StreamedHull : public testing::Test {
 protected:
  void add(const std::string& name, const base::Bytes& file) {
    ASSERT_TRUE(base::writeFileAtomically(directory_ / name, file));
    std::erase_if(scene_.parts, [&](const base::ScenePart& part) { return part.file == name; });
    scene_.parts.push_back({name, file.size(), ""});
  }
  /// The hull ends nowhere before the points, and at most by a share of their extent off them.
  void expectAround(const Points& points, double inside, double outside) {
    const auto set = setStreamedHull(directory_.path(), scene_);
    ASSERT_TRUE(set) << set.error().message;
    ASSERT_FALSE(scene_.hull.empty());
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 300; ++i) {
      const glm::dvec3 direction = glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
      double hull = std::numeric_limits<double>::lowest(), least = -hull, most = hull;
      for (const glm::dvec3& p : scene_.hull) hull = std::max(hull, glm::dot(p - scene_.origin, direction));
      for (const glm::vec3& p : points) {
        const double along = glm::dot(glm::dvec3(p), direction);
        least = std::min(least, along), most = std::max(most, along);
      }
      EXPECT_GE(hull, most - inside * (most - least)) << i;
      EXPECT_LE(hull, most + outside * (most - least)) << i;
    }
  }
  void expectDamaged(const std::string& name, base::Bytes file, std::size_t at) {
    file[at] ^= 1U;
    add(name, file);
    const auto set = setStreamedHull(directory_.path(), scene_);
    ASSERT_FALSE(set);
    EXPECT_EQ(set.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_NE(set.error().message.find(name + ": "), std::string::npos) << set.error().message;
  }

  const support::TemporaryDirectory directory_;
  base::Scene scene_ = [] {
    base::Scene scene;
    scene.origin = {500000.0, 4000000.0, 100.0};
    return scene;
  }();
};

Points pointsOf(const support::MadePmr& made) {
  Points points;
  for (const auto& leaf : made.contents)
    for (const lod::pmr::CodedPoint& point : leaf.vertices) points.push_back(made.header.lattice.position(point.place));
  return points;
}

/// The places of the leaves' triangles.
Points pointsOf(const support::MadeHlod& made) {
  Points points;
  for (std::size_t i = 0; i < made.nodes.size(); ++i)
    if (made.nodes[i].isLeaf())
      for (const lod::hlod::NodeVertex& v : made.pictures[i].vertices)
        points.push_back(made.header.lattice.position(v.place * (1 << made.nodes[i].step_bits)));
  return points;
}

TEST_F(StreamedHull, ofSplatsHoldsTheirPoints) {
  // All leaves are drawn of the first; of the second, inner nodes.
  for (const std::uint32_t side : {60U, 300U}) {
    const support::Mesh ball = support::bumpySphere(side, side, 0.02F);
    add("qsplat.lgq", support::splatFile(ball));
    expectAround(ball.positions, 0.01, side == 60U ? 0.13 : 0.08);
  }
}

TEST_F(StreamedHull, leavesOutStraySplatsThoughTheirSpheresAreLarge) {
  const support::Mesh ball = support::bumpySphere(150, 150, 0.02F);
  support::Mesh with = ball;
  const auto first = static_cast<std::uint32_t>(with.positions.size());
  for (const glm::vec3& p : {glm::vec3(5.0F, 0.0F, 0.0F), glm::vec3(5.0F, 0.01F, 0.0F), glm::vec3(5.0F, 0.0F, 0.01F)})
    with.positions.push_back(p);
  support::addTriangle(with, first, first + 1, first + 2);
  add("qsplat.lgq", support::splatFile(with));
  // Beside a stray in this simple tree lies a point of the ball, whose sphere is large too.
  expectAround(ball.positions, 0.01, 0.25);
}

TEST_F(StreamedHull, ofUmbrellasHoldsTheirPoints) {
  // The finest level of the first; of the second, a coarser one.
  for (const std::uint32_t side : {96U, 256U}) {
    const support::MadePmr made = support::madePmr(side, true, 1000);
    add("pmr.lgm", made.file);
    expectAround(pointsOf(made), 0.01, 0.08);
  }
}

TEST_F(StreamedHull, leavesOutStrayPointsThoughTheirLeafIsLarge) {
  support::LevelledSurface torus = support::bumpyTorus(256, 256);
  const Points points = pointsOf(support::PmrMaker(torus, true, 1000).make());
  for (int i = 0; i < 3; ++i) {
    lod::pmr::CodedPoint stray = torus.points[0];
    stray.place = glm::ivec3((1 << lod::pmr::kPositionBits) - 1000 * (i + 1));
    torus.points.push_back(stray);
    torus.classes.push_back(lod::pmr::kCoarsest);
  }
  add("pmr.lgm", support::PmrMaker(torus, true, 1000).make().file);
  expectAround(points, 0.01, 0.08);
}

TEST_F(StreamedHull, ofAnOctreeHoldsItsSurface) {
  for (const std::uint32_t quads : {8U, 64U}) {
    const support::MadeHlod made = support::HlodMaker(3, quads, true).make();
    add("hlod.lgh", made.file);
    expectAround(pointsOf(made), 0.01, 0.07);
  }
}

TEST_F(StreamedHull, isNoneWithoutSuchFiles) {
  scene_.hull = {{1, 2, 3}};
  ASSERT_TRUE(setStreamedHull(directory_.path(), scene_));
  EXPECT_TRUE(scene_.hull.empty());
}

TEST_F(StreamedHull, damagedFilesAreNamed) {
  const base::Bytes splats = support::splatFile(support::bumpySphere(60, 60, 0.02F));
  expectDamaged("qsplat.lgq", splats, lod::qsplat::kBlockBytes + 100);
  const support::MadePmr umbrellas = support::madePmr();
  scene_.parts.clear();
  expectDamaged("pmr.lgm", umbrellas.file, lod::pmr::kHeaderBytes + umbrellas.header.table_bytes + 20);
  const support::MadeHlod octree = support::HlodMaker(3, 8, true).make();
  expectDamaged("hlod.lgh", octree.file, octree.nodes.back().picture.offset + 20);
}

}  // namespace
}  // namespace server::cli
