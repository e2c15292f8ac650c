#include "server/render/tiling.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <random>

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

TEST(Tiling, bordersCountTowardsTheLimitsAndOnlyBetweenTiles) {
  EXPECT_EQ(planTiles(100, 30, 4, 400, kNoLimit, 3).border, 0);
  const TilePlan plan = planTiles(100, 30, 4, 128, kNoLimit, 3);
  EXPECT_EQ(plan.border, 3);
  EXPECT_LE((plan.tile_width + 6) * 4, 128);
  EXPECT_LE((plan.tile_height + 6) * 4, 128);
  expectCovered(plan, 100, 30);
}

TEST(Tiling, onePixelIsTheSmallestTileEvenBeyondTheLimit) {
  const TilePlan plan = planTiles(3, 2, 8, 4, 1);
  EXPECT_EQ(plan.tile_width, 1);
  EXPECT_EQ(plan.tile_height, 1);
  EXPECT_EQ(plan.tiles.size(), 6U);
}

// A point that lands on pixel (X, Y) of the picture lands on (X − x, Y − y) of the tile, at the same depth.
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

// A camera at (0, 0, 5) that looks along −z: 90° over 100 × 100 pixels, so a plane at distance 5 is 10 wide and a unit
// 10 pixels.
base::Camera lookingDown() {
  base::Camera camera;
  camera.clip_from_eye = glm::perspective(glm::radians(90.0F), 1.0F, 0.1F, 100.0F);
  camera.eye_from_scene = glm::translate(glm::mat4(1.0F), glm::vec3(0, 0, -5));
  camera.eye = {0, 0, 5};
  camera.width = camera.height = 100;
  return camera;
}

Tile boundsOf(const base::Camera& camera, const base::Aabb& box) {
  PixelBounds bounds(camera);
  bounds.add(box);
  return bounds.within(camera.width, camera.height);
}

void expectTile(const Tile& tile, int x, int y, int width, int height) {
  EXPECT_EQ(tile.x, x);
  EXPECT_EQ(tile.y, y);
  EXPECT_EQ(tile.width, width);
  EXPECT_EQ(tile.height, height);
}

TEST(PixelBounds, aSquareAboveTheMiddleIsItsPixelsAndOneMore) {
  expectTile(boundsOf(lookingDown(), {{-1.05F, 2.05F, 0}, {0.95F, 3.05F, 0}}), 38, 18, 23, 13);
}
TEST(PixelBounds, aBoxThatReachesBehindTheEyeIsEverything) {
  expectTile(boundsOf(lookingDown(), {{1, 1, 0}, {2, 2, 5.5F}}), 0, 0, 100, 100);
}
TEST(PixelBounds, aBoxBesideThePictureIsNothingAndNoneIsNothing) {
  EXPECT_EQ(boundsOf(lookingDown(), {{8, 0, 0}, {9, 1, 0}}).width, 0);
  EXPECT_EQ(PixelBounds(lookingDown()).within(100, 100).width, 0);
}
TEST(PixelBounds, tilesThatHangOverThePictureAreCutAtItsEdge) {
  PixelBounds bounds(lookingDown());
  bounds.add(base::Aabb{{-9, -9, 0}, {9, 9, 0}});
  const Tile part = bounds.within(70, 30);
  expectTile(part, 0, 0, 70, 30);
}

TEST(PixelBounds, noPointOfABoxFallsOutside) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(-1.0F, 1.0F);
  const auto anywhere = [&] { return glm::vec3(unit(random), unit(random), unit(random)); };
  for (int round = 0; round < 2000; ++round) {
    base::Aabb box;
    for (int i = 0; i < 2; ++i) box.add(anywhere());
    base::Camera camera = lookingDown();
    camera.eye = 2.0F * anywhere();
    camera.eye_from_scene = glm::lookAt(camera.eye, anywhere(), glm::vec3(0.1F, 0.2F, 1.0F));
    camera.height = 60;
    const Tile tile = boundsOf(camera, box);
    for (int i = 0; i < 20; ++i) {
      const glm::vec3 p = glm::mix(box.min, box.max, 0.5F * (anywhere() + 1.0F));
      const glm::vec4 clip = camera.clipFromScene() * glm::vec4(p, 1.0F);
      const bool seen = clip.w > 0.0F && std::abs(clip.x) < clip.w && std::abs(clip.y) < clip.w;
      if (!seen) continue;
      const glm::vec2 pixel = glm::vec2(100, 60) * (0.5F + glm::vec2(0.5F, -0.5F) * glm::vec2(clip) / clip.w);
      EXPECT_GE(pixel.x, static_cast<float>(tile.x));
      EXPECT_GE(pixel.y, static_cast<float>(tile.y));
      EXPECT_LE(pixel.x, static_cast<float>(tile.x + tile.width));
      EXPECT_LE(pixel.y, static_cast<float>(tile.y + tile.height));
    }
  }
}

}  // namespace
}  // namespace server
