#include "plan/tile_choice.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/geometry.h"
#include "repository/sampling/cube_face.h"

namespace plan {
namespace {

/// A wall at x = 4 before an eye at the middle of a grid of 3 × 3 × 3 points, seen by a camera of 600 pixels a radian.
class TileChoices : public ::testing::Test {
 protected:
  TileChoices() {
    base::Aabb box;
    box.add(glm::vec3(-4.0F));
    box.add(glm::vec3(4.0F));
    query_.points.grid = repository::withTiles(repository::makeGrid(box, 3, 0.0F, 512), 4);
    query_.points.pixels_per_unit_at_one = 600.0F;
    query_.points.eye = glm::vec3(-0.5F, 0.0F, 0.0F);
    for (int y = -10; y <= 10; ++y)
      for (int z = -6; z <= 6; ++z)
        samples_.push_back({glm::vec3(4.0F, 0.15F * static_cast<float>(y), 0.15F * static_cast<float>(z)),
                            glm::vec3(-1.0F, 0.0F, 0.0F), 1.0F / 273.0F});
  }
  std::vector<ChosenTile> choose(float color_error = 0.1F) {
    const std::vector<ProxyShading> proxies(samples_.size(), ProxyShading{color_error, 0.1F, 0.001F});
    return chooseTiles(query_, points_, samples_, proxies);
  }
  static std::uint32_t depthOf(const ChosenTile& tile) { return repository::placeOfTile(tile.key.tile).depth; }

  TileQuery query_;
  std::vector<glm::uvec3> points_{{1, 1, 1}};
  std::vector<SurfaceSample> samples_;
};

TEST_F(TileChoices, goDownToThePixelsOfTheViewAndNoFurther) {
  std::uint32_t deepest = 0;
  for (const ChosenTile& tile : choose()) deepest = std::max(deepest, depthOf(tile));
  // 600 / 4.5 view pixels a unit; a face of 248 · 2^l pixels has 124 · 2^l / 4 of them, so l = 3 is the first with
  // more.
  EXPECT_EQ(deepest, 3U);
}

TEST_F(TileChoices, everyPlaceIsShownAtTheFinestDepthInTheEnd) {
  const auto tiles = choose();
  for (const SurfaceSample& sample : samples_) {
    const auto key = repository::tileOfDirection(sample.position - query_.points.grid.point(1, 1, 1), 3);
    EXPECT_TRUE(std::any_of(tiles.begin(), tiles.end(), [&](const ChosenTile& tile) {
      return tile.key == repository::FaceKey{1, 1, 1, key.d, key.tile};
    }));
  }
}

TEST_F(TileChoices, gainsAreOfErrorsAndFall) {
  const auto tiles = choose();
  ASSERT_FALSE(tiles.empty());
  float sum = 0.0F;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    sum += tiles[i].gain;
    if (i > 0) {
      EXPECT_LE(tiles[i].gain, tiles[i - 1].gain * 1.001F);
    }
  }
  EXPECT_LE(sum, 0.1F * 0.1F + 1.6e-5F);
  EXPECT_GT(sum, 0.5F * 0.1F * 0.1F);
}

TEST_F(TileChoices, aProxyThatErrsNoMoreThanImagesNeedsNone) {
  EXPECT_TRUE(choose(0.005F).empty());
}

TEST_F(TileChoices, tilesThatAreHereAreNotSentAndLessenWhatOthersGain) {
  const auto all = choose();
  query_.is_here = [&](const repository::FaceKey& key) { return key == all.front().key; };
  const auto rest = choose();
  EXPECT_LT(rest.size(), all.size() + 1);
  for (const ChosenTile& tile : rest) EXPECT_NE(tile.key, all.front().key);
}

TEST_F(TileChoices, theAncestorOfAnAbsentTileStandsForIt) {
  query_.is_absent = [](const repository::FaceKey& key) { return repository::placeOfTile(key.tile).depth > 1; };
  const auto tiles = choose();
  ASSERT_FALSE(tiles.empty());
  float sum = 0.0F;
  for (const ChosenTile& tile : tiles) {
    EXPECT_LE(depthOf(tile), 1U);
    sum += tile.gain;
  }
  EXPECT_GT(sum, 0.5F * 0.1F * 0.1F) << "it shows all there is to see";
}

TEST_F(TileChoices, noMoreThanAskedFor) {
  query_.max_tiles = 3;
  EXPECT_EQ(choose().size(), 3U);
}

TEST(TileOfDirection, isTheTileWhoseCameraSeesIt) {
  base::Aabb box;
  box.add(glm::vec3(-1.0F));
  box.add(glm::vec3(1.0F));
  const auto grid = repository::withTiles(repository::makeGrid(box, 2, 0.0F, 512), 3);
  const base::Sphere scene{glm::vec3(0.0F), 10.0F};
  for (int i = 0; i < 500; ++i) {
    const float a = 0.37F * static_cast<float>(i);
    const glm::vec3 direction(std::sin(a), std::cos(1.7F * a), std::sin(2.3F * a + 1.0F));
    for (std::uint32_t depth = 0; depth <= 3; ++depth) {
      const repository::FaceKey key = repository::tileOfDirection(direction, depth);
      const base::Camera camera = repository::faceCamera(grid, key, scene);
      const glm::vec4 clip = camera.clipFromScene() * glm::vec4(camera.eye + direction, 1.0F);
      const float core = static_cast<float>(repository::kTileCore) / static_cast<float>(repository::kTileSide) + 1e-4F;
      ASSERT_GT(clip.w, 0.0F);
      EXPECT_LE(std::abs(clip.x / clip.w), core);
      EXPECT_LE(std::abs(clip.y / clip.w), core);
    }
  }
}

}  // namespace
}  // namespace plan
