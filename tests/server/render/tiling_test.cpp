#include "server/render/tiling.h"

#include <gtest/gtest.h>

namespace server {
namespace {

constexpr std::uint64_t kNoLimit = ~std::uint64_t{0};

// Every pixel of the picture lies in exactly one tile.
void expectCovered(const TilePlan& plan, int width, int height) {
  std::vector<int> count(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (const Tile& tile : plan.tiles)
    for (int y = tile.y; y < tile.y + tile.height; ++y)
      for (int x = tile.x; x < tile.x + tile.width; ++x)
        ++count[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
  for (const int c : count) ASSERT_EQ(c, 1);
}

TEST(Tiling, pictureThatFitsIsOneTile) {
  const TilePlan plan = planTiles(640, 360, 2, 4096, kNoLimit);
  ASSERT_EQ(plan.tiles.size(), 1U);
  EXPECT_EQ(plan.tile_width, 640);
  EXPECT_EQ(plan.tile_height, 360);
}

TEST(Tiling, sidesStayWithinTheLimitInSamples) {
  const TilePlan plan = planTiles(100, 30, 4, 128, kNoLimit);  // 400 × 120 samples: at most 32 pixels a side
  EXPECT_LE(plan.tile_width * 4, 128);
  EXPECT_LE(plan.tile_height * 4, 128);
  EXPECT_EQ(plan.tiles.size(), 4U);
  expectCovered(plan, 100, 30);
}

TEST(Tiling, samplesStayWithinTheLimit) {
  for (const int width : {1, 7, 64, 101})
    for (const int height : {1, 5, 99})
      for (const std::uint64_t limit : {std::uint64_t{4}, std::uint64_t{37}, std::uint64_t{1000}}) {
        const TilePlan plan = planTiles(width, height, 2, 4096, limit);
        EXPECT_LE(static_cast<std::uint64_t>(plan.tile_width * plan.tile_height * 4), limit)
            << width << " x " << height;
        expectCovered(plan, width, height);
      }
}

TEST(Tiling, onePixelIsTheSmallestTileEvenBeyondTheLimit) {
  const TilePlan plan = planTiles(3, 2, 8, 4, 1);
  EXPECT_EQ(plan.tile_width, 1);
  EXPECT_EQ(plan.tile_height, 1);
  EXPECT_EQ(plan.tiles.size(), 6U);
}

// What lands on pixel (X, Y) of the picture lands on (X − x, Y − y) of the tile, and depth is the same.
TEST(Tiling, tileCameraSeesItsPartOfThePicture) {
  base::Camera camera;
  camera.width = 100;
  camera.height = 60;
  camera.clip_from_eye = glm::perspective(1.0F, 100.0F / 60.0F, 0.5F, 20.0F);
  camera.eye_from_scene = glm::lookAt(glm::vec3(3, 2, 5), glm::vec3(0), glm::vec3(0, 1, 0));
  const base::Camera tile = tileCamera(camera, 70, 10, 40, 30);  // hangs over the right edge by 10
  EXPECT_EQ(tile.width, 40);
  EXPECT_EQ(tile.height, 30);

  const auto pixel = [](const base::Camera& c, const glm::vec3& p) {
    const glm::vec4 clip = c.clipFromScene() * glm::vec4(p, 1.0F);
    const glm::vec3 ndc = glm::vec3(clip) / clip.w;
    return glm::vec3((ndc.x + 1.0F) * 0.5F * static_cast<float>(c.width),
                     (1.0F - ndc.y) * 0.5F * static_cast<float>(c.height), ndc.z);
  };
  for (const glm::vec3& p : {glm::vec3(0), glm::vec3(1, -1, 0.5F), glm::vec3(-2, 1, 1)}) {
    const glm::vec3 whole = pixel(camera, p);
    const glm::vec3 part = pixel(tile, p);
    EXPECT_NEAR(part.x, whole.x - 70.0F, 1e-3F);
    EXPECT_NEAR(part.y, whole.y - 10.0F, 1e-3F);
    EXPECT_NEAR(part.z, whole.z, 1e-5F);
  }
}

TEST(Tiling, pixelsPerUnitIsThatOfTheWholePicture) {
  base::Camera camera;
  camera.width = 100;
  camera.height = 60;
  camera.clip_from_eye = glm::perspective(1.0F, 100.0F / 60.0F, 0.5F, 20.0F);
  EXPECT_NEAR(tileCamera(camera, 20, 20, 10, 10).pixelsPerUnitAtOne(), camera.pixelsPerUnitAtOne(), 1e-3F);
}

}  // namespace
}  // namespace server
