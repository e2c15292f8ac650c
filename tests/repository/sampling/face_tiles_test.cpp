#include "repository/sampling/face_tiles.h"

#include <gtest/gtest.h>

namespace repository {
namespace {

// Tile 0 names 1 and 4, tile 4 names its second child, 18.
TEST(FaceTiles, aFaceIsWholeWithAllThatItsTilesName) {
  FaceTiles tiles;
  EXPECT_FALSE(tiles.isWhole());
  EXPECT_TRUE(tiles.add(0, 0b1001));
  EXPECT_EQ(tiles.missing(), (std::vector<std::uint32_t>{1, 4}));
  EXPECT_TRUE(tiles.add(1, 0));
  EXPECT_TRUE(tiles.add(4, 0b0010));
  EXPECT_FALSE(tiles.isWhole());
  EXPECT_EQ(tiles.missing(), (std::vector<std::uint32_t>{18}));
  EXPECT_TRUE(tiles.add(18, 0));
  EXPECT_TRUE(tiles.isWhole());
  EXPECT_TRUE(tiles.missing().empty());
}

TEST(FaceTiles, aPlainFaceIsWholeByItself) {
  FaceTiles tiles;
  EXPECT_TRUE(tiles.add(0, 0));
  EXPECT_TRUE(tiles.isWhole());
}

TEST(FaceTiles, aTileThatNoneNamesBelongsToNoFace) {
  FaceTiles tiles;
  EXPECT_TRUE(tiles.add(0, 0b0001));
  EXPECT_TRUE(tiles.add(1, 0));
  EXPECT_FALSE(tiles.add(2, 0b0001));
  EXPECT_FALSE(tiles.add(9, 0)) << "nor does its child";
  EXPECT_TRUE(tiles.isWhole());
}

TEST(FaceTiles, withoutItsFirstTileNothingIsWhole) {
  FaceTiles tiles;
  EXPECT_FALSE(tiles.add(1, 0));
  EXPECT_FALSE(tiles.isWhole());
  EXPECT_EQ(tiles.missing(), (std::vector<std::uint32_t>{0}));
}

TEST(FaceTiles, childrenThatNoKeyCanNameAreMissingForEver) {
  FaceTiles tiles;
  std::uint32_t tile = 0;
  for (std::uint32_t depth = 0; depth < kMaxTileDepth; ++depth, tile = childOfTile(tile, 3))
    EXPECT_TRUE(tiles.add(tile, 0b1000));
  EXPECT_TRUE(tiles.add(tile, 0b1000));
  EXPECT_EQ(tile, kTileNumbers - 1);
  EXPECT_FALSE(tiles.isWhole());
  EXPECT_EQ(tiles.missing(), (std::vector<std::uint32_t>{childOfTile(tile, 3)}));
}

}  // namespace
}  // namespace repository
