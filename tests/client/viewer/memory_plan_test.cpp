#include "client/viewer/memory_plan.h"

#include <gtest/gtest.h>

#include "client/render/lumigraph.h"

namespace client {
namespace {

TEST(MemoryPlan, theSharesNeverExceedTheBudget) {
  for (const std::uint64_t budget : {16'000'000ULL, 64'000'000ULL, 1'000'000'000ULL, 63'999'999ULL}) {
    const MemoryPlan plan = planMemory(budget, 1ULL << 40U, 1ULL << 40U, true, true);
    EXPECT_LE(plan.cache + plan.frames + plan.patches + plan.images + plan.decoded + plan.smaller_picture, budget)
        << budget;
    EXPECT_GE(plan.smaller_picture, plan.samples) << "they take turns";
    EXPECT_LE(plan.frame_images, plan.images);
  }
}

TEST(MemoryPlan, nobodyGetsMoreThanIsWanted) {
  const MemoryPlan plan = planMemory(1'000'000'000, 50'000'000, 80'000'000, false, true);
  EXPECT_EQ(plan.cache, 50'000'000U);
  EXPECT_EQ(plan.images, 80'000'000U);
  EXPECT_EQ(plan.frame_images, 0U) << "no frames, no share for them";
}

TEST(MemoryPlan, samplesHaveAShareWhereTheyAreWantedAndThereIsEnough) {
  // Four samples of colour and depth for each pixel of 2560 x 1440, and what blends each once.
  EXPECT_GE(planMemory(1'000'000'000, 50'000'000, 512'000'000, true, true).samples,
            2560U * 1440U * 4U * 8U + client::LumigraphRenderer::bytesToBlendOnce(2560, 1440));
  EXPECT_EQ(planMemory(1'000'000'000, 50'000'000, 512'000'000, true, false).samples, 0U);
  EXPECT_EQ(planMemory(64'000'000, 50'000'000, 512'000'000, true, true).samples, 0U);
}

TEST(MemoryPlan, aPhonesMovingViewMayHaveHalfOfItsWidth) {
  EXPECT_GE(planMemory(64'000'000, 50'000'000, 512'000'000, true, true).smaller_picture, 1000U * 500U * 8U)
      << "of 2000 x 1000 pixels";
}

TEST(MemoryPlan, aPhoneHoldsAFaceOfAThousandPixelsAndTheUsualTriangles) {
  const MemoryPlan plan = planMemory(64'000'000, 50'000'000, 512'000'000, true, true);
  EXPECT_GE(plan.decoded, 4U * 1024 * 1024);
  // The images are twelve faces of 512 pixels with mip levels and depth maps of 256, and a frame of 1.5 million pixels.
  EXPECT_GE(plan.images - plan.frame_images, 12U * (512U * 512U * 16U / 3U + 256U * 256U * 4U));
  EXPECT_GE(plan.frame_images, 1'500'000U * 16U / 3U + 256U * 256U * 4U);
  EXPECT_GE(plan.decoded, 1'500'000U * 4U);
  EXPECT_GE(trianglesFor(plan.patches), 200'000U);
}

}  // namespace
}  // namespace client
