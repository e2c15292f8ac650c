#include "repository/sampling/wanted_tiles.h"

#include <gtest/gtest.h>

#include "repository/sampling/parameters.h"

namespace repository {
namespace {

Grid testGrid(std::uint32_t depth = 3) {
  Grid grid;
  grid.count = {9, 5, 9};
  grid.spacing = 1.0F;
  return withTiles(grid, depth);
}

// Tile 30 has the ancestors 7 and 1.
const FaceKey kDeep{3, 0, 7, 5, 30};

TEST(WantedTiles, aTileComesWithItsAncestorsAndEveryFaceWithTile0) {
  const WantedTiles wanted({kDeep, {3, 0, 7, 5, 7}, {3, 0, 7, 4, 2}});
  EXPECT_EQ(wanted.ofFace({3, 0, 7, 5}), (std::vector<std::uint32_t>{0, 1, 7, 30}));
  EXPECT_EQ(wanted.ofFace({3, 0, 7, 4}), (std::vector<std::uint32_t>{0, 2}));
  EXPECT_EQ(wanted.ofFace({3, 0, 7, 3}), (std::vector<std::uint32_t>{0}));
  EXPECT_EQ(wanted.count(), 4U);
  EXPECT_TRUE(wanted.has(kDeep));
  EXPECT_TRUE(wanted.has({3, 0, 7, 5, 1}));
  EXPECT_TRUE(wanted.has({8, 4, 8, 0, 0}));
  EXPECT_FALSE(wanted.has({3, 0, 7, 5, 2}));
  EXPECT_FALSE(wanted.has({3, 0, 6, 5, 1}));
}

TEST(WantedTiles, comeBackFromTheirBytes) {
  std::vector<FaceKey> keys{kDeep, {0, 0, 0, 0, 84}, {8, 4, 8, 5, 21}};
  for (std::uint32_t tile = 1; tile < firstTileOf(4); ++tile) keys.push_back({5, 2, 1, 3, tile});
  for (const WantedTiles& wanted : {WantedTiles(), WantedTiles({kDeep}), WantedTiles(keys)}) {
    const base::Bytes bytes = wanted.encode(testGrid());
    const auto back = WantedTiles::decode(testGrid(), bytes);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(*back, wanted);
    EXPECT_EQ(back->encode(testGrid()), bytes);
  }
}

// docs/formats/repository.md, "Tiles by use".
TEST(WantedTiles, haveTheBytesOfTheDocument) {
  const base::Bytes bytes = WantedTiles({{0, 0, 0, 1, 6}, {0, 0, 0, 2, 1}}).encode(testGrid(2));
  EXPECT_EQ(base::hexOf(base::ByteView(bytes).first(bytes.size() - 4)),
            "57010121"
            "0101");
}

TEST(WantedTiles, damagedBytesAndOtherGridsAreErrors) {
  const base::Bytes bytes = WantedTiles({kDeep, {0, 0, 0, 0, 84}}).encode(testGrid());
  for (std::size_t length = 0; length < bytes.size(); ++length)
    EXPECT_FALSE(WantedTiles::decode(testGrid(), base::ByteView(bytes).first(length))) << length;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    base::Bytes wrong = bytes;
    wrong[i] ^= 1U;
    EXPECT_FALSE(WantedTiles::decode(testGrid(), wrong)) << i;
  }
  Grid smaller = testGrid();
  smaller.count.z = 7;
  EXPECT_FALSE(WantedTiles::decode(smaller, bytes));
  EXPECT_FALSE(WantedTiles::decode(testGrid(1), bytes));
}

TEST(WantedTiles, standInTheParametersBehindTheTree) {
  const std::string parameters = "{\n\"version\": 2,\n\"quality\": 80\n}\n";
  const std::string with_tree = withTree(parameters, SampleTree(testGrid(), 4));
  const WantedTiles wanted({kDeep});
  const std::string text = withTiles(with_tree, testGrid(), wanted);
  const auto back = tilesFromText(text, testGrid(), "images");
  ASSERT_TRUE(back && *back);
  EXPECT_EQ(**back, wanted);
  EXPECT_TRUE(*treeFromText(text, testGrid(), "images"));
  EXPECT_EQ(withoutTiles(text), with_tree);
  EXPECT_EQ(withoutSelection(text), parameters);
  EXPECT_FALSE(*tilesFromText(with_tree, testGrid(), "images"));
  EXPECT_EQ(firstDifference(text, with_tree), "other sampling points");
  std::string damaged = text;
  damaged.replace(damaged.find("\"tiles\": \"") + 10, 2, "zz");
  const auto refused = tilesFromText(damaged, testGrid(), "scene/images");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message.rfind("scene/images: the tiles chosen by use are damaged", 0), 0U);
}

}  // namespace
}  // namespace repository
