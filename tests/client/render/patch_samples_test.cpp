#include "client/render/patch_samples.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

namespace client {
namespace {

/// Samples that look down at a ground of patches from 10 units above it, and a viewer 20 units above its middle.
class PatchSamplesTest : public ::testing::Test {
 protected:
  static base::Camera cameraAbove(float x, float height, int width) {
    base::ViewCamera view;
    view.position = {x, 0.0, height};
    view.direction = {0.0, 0.0, -1.0};
    view.up = {0.0, 1.0, 0.0};
    view.fov_y = 1.5;
    view.width = view.height = width;
    return base::cameraFromView(view, glm::dvec3(0.0), 0.1F, 100.0F);
  }
  /// `point`: equal numbers are the same eye; a larger `width` is a finer picture.
  void addSample(float x, std::uint32_t point, int width = 512) {
    made_.push_back(std::make_unique<SampleGeometry>(cameraAbove(x, 10.0F, width)));
    samples.push_back(made_.back().get());
    points.push_back(point);
  }
  void addPatch(float x) {
    boxes.push_back({{x - 0.5F, -0.5F, 0.0F}, {x + 0.5F, 0.5F, 0.1F}});
    errors.push_back({0.01F, 0.1F});
  }
  std::vector<std::vector<std::uint32_t>> lists(std::size_t max_points) const {
    return samplesOfPatches(samples, points, boxes, errors, cameraAbove(0.0F, 20.0F, 512), max_points, BlendTuning{});
  }

  std::vector<const SampleGeometry*> samples;
  std::vector<std::uint32_t> points;
  std::vector<base::Aabb> boxes;
  std::vector<ProxyError> errors;
  std::vector<std::unique_ptr<SampleGeometry>> made_;
};

using Lists = std::vector<std::vector<std::uint32_t>>;

TEST_F(PatchSamplesTest, aPatchHasTheSamplesThatMaySeeIt) {
  addSample(0.0F, 0);
  addSample(100.0F, 1);
  addPatch(0.0F);
  addPatch(100.0F);
  addPatch(-100.0F);
  EXPECT_EQ(lists(8), (Lists{{0}, {1}, {}}));
}

TEST_F(PatchSamplesTest, theBestPointsAreLeftInTheirOrder) {
  for (int i = 0; i < 5; ++i) addSample(-4.0F + 2.0F * static_cast<float>(i), static_cast<std::uint32_t>(i));
  addPatch(0.0F);
  EXPECT_EQ(lists(5), (Lists{{0, 1, 2, 3, 4}}));
  EXPECT_EQ(lists(3), (Lists{{1, 2, 3}})) << "those whose rays are nearest to the viewer's";
  EXPECT_EQ(lists(1), (Lists{{2}}));
}

TEST_F(PatchSamplesTest, eachPatchHasItsOwn) {
  addSample(-6.0F, 0);
  addSample(6.0F, 1);
  addPatch(-6.0F);
  addPatch(6.0F);
  EXPECT_EQ(lists(1), (Lists{{0}, {1}}));
}

TEST_F(PatchSamplesTest, coarseAndFineOfAPointCountOnceAndStay) {
  addSample(0.5F, 0, 1024);
  addSample(0.5F, 0, 256);
  addSample(4.0F, 1, 1024);
  addPatch(0.0F);
  EXPECT_EQ(lists(2), (Lists{{0, 1, 2}}));
  EXPECT_EQ(lists(1), (Lists{{0, 1}}));
}

TEST_F(PatchSamplesTest, aCoarsePictureGivesWayToAFineOneAsNear) {
  addSample(-1.0F, 0, 64);
  addSample(1.0F, 1, 1024);
  addPatch(0.0F);
  EXPECT_EQ(lists(1), (Lists{{1}}));
}

TEST_F(PatchSamplesTest, anEyeInThePatchIsNotItsBest) {
  addSample(0.0F, 0);
  addSample(1.0F, 1);
  addPatch(0.0F);
  boxes[0] = {{-1.0F, -1.0F, 9.0F}, {1.0F, 1.0F, 11.0F}};
  EXPECT_EQ(lists(2), (Lists{{0, 1}}));
  EXPECT_EQ(lists(1), (Lists{{1}})) << "from most of the patch it looks another way than the viewer";
}

class PatchCellsTest : public PatchSamplesTest {
 protected:
  std::vector<PatchCells> cells() const {
    return cellsOfPatches(lists(kMaxBlended), samples, boxes, cameraAbove(0.0F, 20.0F, 512));
  }
};

TEST_F(PatchCellsTest, aSmallPatchIsOne) {
  addSample(0.0F, 0);
  addPatch(0.0F);  // 28 pixels wide
  const std::vector<PatchCells> made = cells();
  ASSERT_EQ(made.size(), 1U);
  EXPECT_EQ(made[0].counts, glm::ivec3(1));
  EXPECT_EQ(made[0].lists, (Lists{{0}}));
  EXPECT_EQ(made[0].samples, 1U);
}

TEST_F(PatchCellsTest, whoSeesAPlaceIsInTheListOfItsCell) {
  for (int i = -4; i <= 4; ++i) {
    made_.push_back(std::make_unique<SampleGeometry>(cameraAbove(2.0F * static_cast<float>(i), 2.0F, 64)));
    samples.push_back(made_.back().get());
    points.push_back(static_cast<std::uint32_t>(samples.size()));
  }
  addPatch(0.0F);
  boxes[0] = {{-9.0F, -1.0F, -0.1F}, {9.0F, 1.0F, 0.1F}};
  const PatchCells made = cells().at(0);
  EXPECT_EQ(made.counts, glm::ivec3(4, 1, 1));
  ASSERT_EQ(made.lists.size(), 4U);
  EXPECT_EQ(made.samples, 9U);
  for (float x = -8.9F; x < 9.0F; x += 0.1F) {
    const glm::vec3 place(x, 0.5F, 0.0F);
    const glm::ivec3 at(glm::floor((place - made.begin) * made.per_unit));
    const auto& list = made.lists[static_cast<std::size_t>(at.x + made.counts.x * (at.y + made.counts.y * at.z))];
    EXPECT_LE(list.size(), 5U) << x;
    for (std::uint32_t s = 0; s < samples.size(); ++s) {
      if (std::abs(x - samples[s]->eye.x) > 1.8F) continue;  // a picture shows 1.86 to either side
      EXPECT_EQ(std::count(list.begin(), list.end(), s), 1) << x << " " << s;
    }
  }
}

}  // namespace
}  // namespace client
