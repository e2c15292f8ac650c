#include "repository/sampling/key.h"

#include <gtest/gtest.h>

#include <random>

namespace repository {
namespace {

// An independent way to the same code goes bit by bit, as the definition says.
std::uint64_t slowCode(const FaceKey& key) {
  std::uint64_t code = key.d;
  for (unsigned bit = 0; bit < 20; ++bit) {
    code |= std::uint64_t{key.x >> bit & 1U} << (3 + 3 * bit);
    code |= std::uint64_t{key.y >> bit & 1U} << (4 + 3 * bit);
    code |= std::uint64_t{key.z >> bit & 1U} << (5 + 3 * bit);
  }
  return code;
}

TEST(FaceKey, codeInterleavesTheBits) {
  EXPECT_EQ((FaceKey{0, 0, 0, 5}.code()), 5U);
  EXPECT_EQ((FaceKey{1, 0, 0, 0}.code()), 8U);
  EXPECT_EQ((FaceKey{0, 1, 0, 0}.code()), 16U);
  EXPECT_EQ((FaceKey{0, 0, 1, 0}.code()), 32U);
  EXPECT_EQ((FaceKey{3, 0, 1, 2}.code()), (8U | 64U | 32U | 2U));
  EXPECT_EQ((FaceKey{kMaxGridIndex, kMaxGridIndex, kMaxGridIndex, 5}.code()), (std::uint64_t{1} << 63) - 3);
}

TEST(FaceKey, codeAndBackIsTheSameKeyEverywhere) {
  std::mt19937 random(1);
  for (int i = 0; i < 20000; ++i) {
    const unsigned shift = random() % 20;
    const FaceKey key{(static_cast<std::uint32_t>(random()) & kMaxGridIndex) >> shift,
                      static_cast<std::uint32_t>(random()) & kMaxGridIndex,
                      static_cast<std::uint32_t>(random()) & kMaxGridIndex, static_cast<std::uint32_t>(random() % 6)};
    ASSERT_EQ(key.code(), slowCode(key));
    const auto back = FaceKey::fromCode(key.code());
    ASSERT_TRUE(back);
    ASSERT_EQ(*back, key);
  }
}

TEST(FaceKey, facesOfOnePointAreNeighboursInOrder) {
  const FaceKey last{5, 6, 7, 5};
  EXPECT_EQ((FaceKey{5, 6, 7, 0}.code()) + 5, last.code());
  EXPECT_LT((FaceKey{7, 7, 7, 5}), (FaceKey{8, 0, 0, 0}));
}

TEST(FaceKey, fromCodeRefusesDirectionsAndBitsThatNoKeyHas) {
  EXPECT_FALSE(FaceKey::fromCode(6));
  EXPECT_FALSE(FaceKey::fromCode(7));
  EXPECT_FALSE(FaceKey::fromCode(std::uint64_t{1} << 63));
  EXPECT_FALSE(FaceKey::fromCode(~std::uint64_t{0}));
  EXPECT_TRUE(FaceKey::fromCode((std::uint64_t{1} << 63) - 3));
}

}  // namespace
}  // namespace repository
