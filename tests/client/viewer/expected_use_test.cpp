#include "client/viewer/expected_use.h"

#include <gtest/gtest.h>

#include <numeric>

#include "repository/sampling/cube_face.h"

namespace client {
namespace {

base::Camera looking(const glm::dvec3& from, const glm::dvec3& to) {
  base::ViewCamera view;
  view.position = from;
  view.direction = glm::normalize(to - from);
  view.up = {0.0, 0.0, 1.0};
  view.width = 200;
  view.height = 200;
  return base::cameraFromView(view, glm::dvec3(0.0), 0.01F, 100.0F);
}

//   The anchors lie around the origin; the viewer at (4, 0, 0).
//        near (4, 0.3, 0)      far (0, 4, 0)      away: near, but turned from the anchors
class ExpectedUse : public ::testing::Test {
 protected:
  const base::Camera view = looking({4.0, 0.0, 0.0}, {0.0, 0.0, 0.0});
  const base::Camera near = looking({4.0, 0.3, 0.0}, {0.0, 0.0, 0.0});
  const base::Camera far = looking({0.0, 4.0, 0.0}, {0.0, 0.0, 0.0});
  const base::Camera away = looking({4.0, 0.3, 0.0}, {8.0, 0.3, 0.0});
  const std::vector<glm::vec3> anchors{glm::vec3(0.0F), glm::vec3(0.1F, 0.2F, 0.0F), glm::vec3(0.0F, -0.2F, 0.2F)};

  std::vector<float> use(std::vector<const base::Camera*> samples) const { return expectedUse(anchors, view, samples); }
};

TEST_F(ExpectedUse, theImageFromANearerAngleIsUsedMore) {
  const auto shares = use({&far, &near});
  EXPECT_GT(shares[1], 5.0F * shares[0]);
  EXPECT_NEAR(shares[0] + shares[1], 1.0F, 1e-5F);
}

TEST_F(ExpectedUse, anImageBehindAWallIsNotUsed) {
  const std::vector<const base::Camera*> samples{&near, &far};
  const auto shares = expectedUse(
      anchors, view, samples, [&](const glm::vec3& eye, std::size_t anchor) { return eye == far.eye && anchor < 2; });
  EXPECT_EQ(shares[0], 0.0F);
  EXPECT_NEAR(shares[1], 2.0F / 3.0F, 1e-5F) << "one of three anchors is seen by none";
}

TEST_F(ExpectedUse, anImageThatLooksElsewhereIsNotUsed) {
  const auto shares = use({&away, &near});
  EXPECT_EQ(shares[0], 0.0F);
}

TEST_F(ExpectedUse, theImageFromTheVeryEyeIsUsedMost) {
  const auto shares = use({&near, &view});
  EXPECT_GT(shares[1], shares[0]);
}

TEST_F(ExpectedUse, prefersTheFinerOfTwoImagesAtOneAngle) {
  base::Camera coarse = near;
  coarse.width = 50;
  coarse.height = 50;
  const auto shares = use({&coarse, &near});
  EXPECT_GT(shares[1], 100.0F * shares[0]) << "the blend weighs by the sixth power of blur";
}

TEST_F(ExpectedUse, twoOfAKindShare) {
  const auto shares = use({&near, &near});
  EXPECT_NEAR(shares[0], 0.5F, 1e-5F);
}

TEST_F(ExpectedUse, withoutAnchorsOrSamplesNothingIsUsed) {
  EXPECT_EQ(expectedUse({}, view, std::vector<const base::Camera*>{&near}), std::vector<float>{0.0F});
  EXPECT_TRUE(use({}).empty());
}

TEST(Anchors, areInTheViewAndFew) {
  lod::patch::Hierarchy hierarchy;
  std::vector<std::uint32_t> cut;
  for (std::uint32_t i = 0; i < 1000; ++i) {
    lod::patch::Patch patch;
    patch.bounds = {glm::vec3(0.0F, 0.02F * static_cast<float>(i) - 10.0F, 0.0F), 0.1F};
    hierarchy.patches.push_back(patch);
    cut.push_back(i);
  }
  const base::Camera view = looking({4.0, 0.0, 0.0}, {0.0, 0.0, 0.0});
  const auto anchors = anchorsInView(hierarchy, cut, view);
  EXPECT_EQ(anchors.size(), kMaxAnchors);
  float lowest = 0.0F;
  float highest = 0.0F;
  for (const glm::vec3& anchor : anchors) {
    const glm::vec4 clip = view.clipFromScene() * glm::vec4(anchor, 1.0F);
    EXPECT_LE(std::abs(clip.x), clip.w);
    lowest = std::min(lowest, anchor.y);
    highest = std::max(highest, anchor.y);
  }
  EXPECT_LT(lowest, -1.0F) << "they are spread over all of it";
  EXPECT_GT(highest, 1.0F);
}

TEST(Anchors, thereAreNoneWhenTheSceneIsBehind) {
  lod::patch::Hierarchy hierarchy;
  hierarchy.patches.resize(1);
  hierarchy.patches[0].bounds = {glm::vec3(10.0F, 0.0F, 0.0F), 1.0F};
  const std::vector<std::uint32_t> cut{0};
  EXPECT_TRUE(anchorsInView(hierarchy, cut, looking({4.0, 0.0, 0.0}, {0.0, 0.0, 0.0})).empty());
}

}  // namespace
}  // namespace client
