#include "repository/sampling/key.h"

#include <gtest/gtest.h>

#include <random>

namespace repository {
namespace {

// An independent way to the same code goes bit by bit, as the definition says.
std::uint64_t slowCode(const FaceKey& key) {
  std::uint64_t code = std::uint64_t{key.d} << 11 | key.tile;
  for (unsigned bit = 0; bit < 16; ++bit) {
    code |= std::uint64_t{key.x >> bit & 1U} << (14 + 3 * bit);
    code |= std::uint64_t{key.y >> bit & 1U} << (15 + 3 * bit);
    code |= std::uint64_t{key.z >> bit & 1U} << (16 + 3 * bit);
  }
  return code;
}

TEST(FaceKey, codeInterleavesTheBits) {
  EXPECT_EQ((FaceKey{0, 0, 0, 0, 7}.code()), 7U);
  EXPECT_EQ((FaceKey{0, 0, 0, 5}.code()), 5U << 11);
  EXPECT_EQ((FaceKey{1, 0, 0, 0}.code()), 1U << 14);
  EXPECT_EQ((FaceKey{0, 1, 0, 0}.code()), 2U << 14);
  EXPECT_EQ((FaceKey{0, 0, 1, 0}.code()), 4U << 14);
  EXPECT_EQ((FaceKey{3, 0, 1, 2}.code()), ((1U | 8U | 4U) << 14 | 2U << 11));
  EXPECT_EQ((FaceKey{kMaxGridIndex, kMaxGridIndex, kMaxGridIndex, 5, kTileNumbers - 1}.code()),
            (std::uint64_t{1} << 62) - (3U << 11) + kTileNumbers - 1);
}

TEST(FaceKey, codeAndBackIsTheSameKeyEverywhere) {
  std::mt19937 random(1);
  for (int i = 0; i < 20000; ++i) {
    const unsigned shift = random() % 16;
    const FaceKey key{(static_cast<std::uint32_t>(random()) & kMaxGridIndex) >> shift,
                      static_cast<std::uint32_t>(random()) & kMaxGridIndex,
                      static_cast<std::uint32_t>(random()) & kMaxGridIndex, static_cast<std::uint32_t>(random() % 6),
                      static_cast<std::uint32_t>(random() % kTileNumbers)};
    ASSERT_EQ(key.code(), slowCode(key));
    const auto back = FaceKey::fromCode(key.code());
    ASSERT_TRUE(back);
    ASSERT_EQ(*back, key);
  }
}

TEST(FaceKey, facesOfOnePointAreNeighboursInOrder) {
  const FaceKey last{5, 6, 7, 5};
  EXPECT_EQ((FaceKey{5, 6, 7, 0}.code()) + (5U << 11), last.code());
  EXPECT_LT((FaceKey{5, 6, 7, 4, kTileNumbers - 1}), last);
  EXPECT_LT((FaceKey{7, 7, 7, 5}), (FaceKey{8, 0, 0, 0}));
}

TEST(FaceKey, fromCodeRefusesDirectionsAndBitsThatNoKeyHas) {
  EXPECT_FALSE(FaceKey::fromCode(6U << 11));
  EXPECT_FALSE(FaceKey::fromCode(7U << 11));
  EXPECT_FALSE(FaceKey::fromCode(kTileNumbers));
  EXPECT_FALSE(FaceKey::fromCode(std::uint64_t{1} << 62));
  EXPECT_FALSE(FaceKey::fromCode(~std::uint64_t{0}));
  EXPECT_TRUE(FaceKey::fromCode((std::uint64_t{1} << 62) - (3U << 11)));
}

TEST(Tiles, childrenLieInTheirParent) {
  for (std::uint32_t tile = 1; tile < kTileNumbers; ++tile) {
    const TilePlace place = placeOfTile(tile);
    ASSERT_EQ(tileAt(place), tile);
    const TilePlace parent = placeOfTile(parentOfTile(tile));
    EXPECT_EQ(parent, (TilePlace{place.depth - 1, place.x / 2, place.y / 2}));
    EXPECT_EQ(childOfTile(parentOfTile(tile), (place.x & 1U) + 2 * (place.y & 1U)), tile);
  }
}

}  // namespace
}  // namespace repository
