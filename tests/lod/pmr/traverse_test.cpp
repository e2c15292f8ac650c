#include "lod/pmr/traverse.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "tests/support/made_pmr.h"
#include "tests/support/random_views.h"

namespace lod::pmr {
namespace {

const support::MadePmr& made() {
  static const support::MadePmr file = support::madePmr(128, false, 150);
  return file;
}

glm::vec2 pixelOf(const base::Camera& camera, const glm::vec3& point) {
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(point, 1.0F);
  return 0.5F * glm::vec2(static_cast<float>(camera.width) * clip.x, static_cast<float>(camera.height) * clip.y) /
         clip.w;
}

bool isSeen(const base::Camera& camera, const glm::vec3& point) {
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(point, 1.0F);
  return clip.w > 0.0F && std::abs(clip.x) <= clip.w && std::abs(clip.y) <= clip.w && std::abs(clip.z) <= clip.w;
}

TEST(PmrTraverseTest, aPixelIsNoLargerThanWhatIsSeenInTheBox) {
  support::RandomViews views(1, made().header.bounds, 500);
  int compared = 0;
  for (int i = 0; i < 300; ++i) {
    const base::Camera camera = views.next();
    const Leaf& leaf = made().leaves[static_cast<std::size_t>(i) % made().leaves.size()];
    const float pixel = pixelSizeAt(camera, leaf.box);
    ASSERT_GT(pixel, 0.0F);
    // Short steps of any direction from points of the box move at most by their length in such pixels.
    for (int k = 0; k < 100; ++k) {
      const auto part = [&] { return static_cast<float>(views.number(0.0, 1.0)); };
      const glm::vec3 p = leaf.box.min + glm::vec3(part(), part(), part()) * leaf.box.size();
      if (!isSeen(camera, p)) continue;
      ++compared;
      // Steps parallel to the picture.
      const glm::mat3 scene_from_eye = glm::transpose(glm::mat3(camera.eye_from_scene));
      const auto turn = static_cast<float>(views.number(0.0, 6.28));
      const glm::vec3 step = scene_from_eye * glm::vec3(std::cos(turn), std::sin(turn), 0.0F);
      const float length = 0.01F * leaf.box.diagonal();
      ASSERT_LE(glm::length(pixelOf(camera, p + length * step) - pixelOf(camera, p)), 1.02F * length / pixel + 0.01F);
    }
  }
  EXPECT_GT(compared, 3000);
}

TEST(PmrTraverseTest, pixelsAreExactStraightAhead) {
  base::ViewCamera view;
  view.position = {0.0, 0.0, 5.0};
  view.width = 200, view.height = 100;
  const base::Aabb box{glm::vec3(-0.1F), glm::vec3(0.1F)};
  const base::Camera camera = base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 100.0F);
  const float expected = 4.9F * 2.0F * std::tan(0.5F * static_cast<float>(view.fov_y)) / 100.0F;
  EXPECT_NEAR(pixelSizeAt(camera, box), expected, 1e-4F * expected);

  // Around the eye a pixel is one at the near plane.
  const base::Aabb around{glm::vec3(-10.0F), glm::vec3(10.0F)};
  EXPECT_NEAR(pixelSizeAt(camera, around), expected * 0.1F / 4.9F, 1e-3F * expected);

  view.ortho_height = 3.0;
  const base::Camera parallel = base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 100.0F);
  EXPECT_NEAR(pixelSizeAt(parallel, box), 0.03F, 1e-6F);
  EXPECT_NEAR(pixelSizeAt(parallel, around), 0.03F, 1e-6F);
}

Leaf leafWithRadii(const std::vector<float>& radii) {
  Leaf leaf;
  for (std::size_t l = 0; l < radii.size(); ++l) leaf.levels[l].radius = radii[l];
  return leaf;
}

TEST(PmrTraverseTest, theLevelIsTheOneWhoseRadiusIsNearestByRatio) {
  const Leaf leaf = leafWithRadii({1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024});
  EXPECT_EQ(levelFor(leaf, 0.001F, 1.0F), 0U);
  EXPECT_EQ(levelFor(leaf, 1.3F, 1.0F), 0U);
  EXPECT_EQ(levelFor(leaf, 1.5F, 1.0F), 1U);
  EXPECT_EQ(levelFor(leaf, 100.0F, 1.0F), 7U);
  EXPECT_EQ(levelFor(leaf, 80.0F, 1.0F), 6U);
  EXPECT_EQ(levelFor(leaf, 1e9F, 1.0F), 10U);
  EXPECT_EQ(levelFor(leaf, 4.0F, 0.25F), 0U);
}

TEST(PmrTraverseTest, theToleranceFadesBetweenPixelsOfTwoAndFourRadii) {
  const Leaf leaf = leafWithRadii({1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024});
  EXPECT_EQ(levelFor(leaf, 1.0F, 8.0F), 3U);
  EXPECT_EQ(levelFor(leaf, 2.0F, 8.0F), 4U);
  EXPECT_EQ(levelFor(leaf, 3.0F, 8.0F), 4U);  // 3 × 4.5 = 13.5
  EXPECT_EQ(levelFor(leaf, 4.0F, 8.0F), 2U);
  EXPECT_EQ(levelFor(leaf, 32.0F, 8.0F), 5U);
  EXPECT_EQ(levelFor(leaf, 32.0F, 0.25F), 3U);  // below 1 it stays
}

TEST(PmrTraverseTest, levelsWithoutTrianglesAreNotChosenUnlessThereAreNoOthers) {
  EXPECT_EQ(levelFor(leafWithRadii({1, 0, 4}), 1e6F, 1.0F), 2U);
  EXPECT_EQ(levelFor(leafWithRadii({1, 0, 4}), 1.9F, 1.0F), 0U);
  EXPECT_EQ(levelFor(leafWithRadii({0, 0, 4}), 0.1F, 1.0F), 2U);
  EXPECT_EQ(levelFor(leafWithRadii({}), 1.0F, 1.0F), 0U);
  EXPECT_EQ(levelFor(leafWithRadii({1, 3, 3, 3}), 3.0F, 1.0F), 3U);  // the coarsest of equal ones
}

/// All leaves, each tested by itself.
std::vector<ChosenLeaf> chosenByHand(const TraverseRequest& request) {
  const base::Frustum frustum(request.camera.clipFromScene());
  std::vector<ChosenLeaf> chosen;
  for (std::uint32_t i = 0; i < made().leaves.size(); ++i) {
    const Leaf& leaf = made().leaves[i];
    if (request.cull && !frustum.mayOverlap(leaf.box)) continue;
    bool beyond = true;
    for (int k = 0; k < 8; ++k)
      beyond &= glm::dot(glm::vec3(request.camera.section), leaf.box.corner(k)) > request.camera.section.w;
    if (beyond) continue;
    const float pixel = pixelSizeAt(request.camera, leaf.box);
    chosen.push_back({i, levelFor(leaf, pixel, request.tolerance), pixel, leaf.box.diagonal() / pixel});
  }
  return chosen;
}

TEST(PmrTraverseTest, theOctreeChoosesWhatATestOfEachLeafChooses) {
  const Octree octree(made().leaves);
  support::RandomViews views(7, made().header.bounds, 400);
  std::size_t culled = 0, seen = 0, parallel = 0;
  for (int i = 0; i < 400; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    parallel += request.camera.orthographic() ? 1 : 0;
    request.tolerance = static_cast<float>(views.number(0.3, 6.0));
    request.cull = i % 5 != 0;
    if (i % 3 == 0)
      request.camera.section = glm::vec4(glm::vec3(views.direction()), static_cast<float>(views.number(-1.0, 1.0)));
    std::vector<ChosenLeaf> chosen;
    octree.choose(made().leaves, request, chosen);
    EXPECT_TRUE(std::is_sorted(chosen.begin(), chosen.end(),
                               [](const ChosenLeaf& a, const ChosenLeaf& b) { return a.priority > b.priority; }));
    std::map<std::uint32_t, ChosenLeaf> by_leaf;
    for (const ChosenLeaf& one : chosen) by_leaf[one.leaf] = one;
    const std::vector<ChosenLeaf> expected = chosenByHand(request);
    ASSERT_EQ(chosen.size(), expected.size()) << "view " << i;
    for (const ChosenLeaf& one : expected) {
      ASSERT_EQ(by_leaf.count(one.leaf), 1U);
      EXPECT_EQ(by_leaf[one.leaf].level, one.level);
      EXPECT_EQ(by_leaf[one.leaf].pixel, one.pixel);
    }
    seen += chosen.size();
    culled += made().leaves.size() - chosen.size();
  }
  EXPECT_GT(culled, 5000U);
  EXPECT_GT(seen, 5000U);
  EXPECT_GT(parallel, 20U);
}

TEST(PmrTraverseTest, aTileHasTheLevelsOfItsPicture) {
  const Octree octree(made().leaves);
  support::RandomViews views(3, made().header.bounds, 400);
  std::size_t fewer = 0;
  for (int i = 0; i < 100; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    std::vector<ChosenLeaf> whole, part;
    octree.choose(made().leaves, request, whole);
    std::map<std::uint32_t, ChosenLeaf> by_leaf;
    for (const ChosenLeaf& one : whole) by_leaf[one.leaf] = one;
    // The picture's middle.
    request.tile = request.camera;
    for (int column = 0; column < 4; ++column)
      for (int row = 0; row < 2; ++row) request.tile->clip_from_eye[column][row] *= 3.0F;
    octree.choose(made().leaves, request, part);
    for (const ChosenLeaf& one : part) {
      ASSERT_EQ(by_leaf.count(one.leaf), 1U);
      EXPECT_EQ(by_leaf[one.leaf].level, one.level);
      EXPECT_EQ(by_leaf[one.leaf].pixel, one.pixel);
    }
    fewer += part.size() < whole.size() ? 1 : 0;
  }
  EXPECT_GT(fewer, 50U);
}

TEST(PmrTraverseTest, aCameraOfNumbersThatAreNoneStillGivesAnOrder) {
  const Octree octree(made().leaves);
  TraverseRequest request;
  request.camera.clip_from_eye[1][1] = std::numeric_limits<float>::quiet_NaN();
  request.cull = false;
  std::vector<ChosenLeaf> chosen;
  octree.choose(made().leaves, request, chosen);
  EXPECT_EQ(chosen.size(), made().leaves.size());
  for (const ChosenLeaf& one : chosen) EXPECT_GT(one.pixel, 0.0F);
  Octree({}).choose({}, request, chosen);
  EXPECT_TRUE(chosen.empty());
}

}  // namespace
}  // namespace lod::pmr
