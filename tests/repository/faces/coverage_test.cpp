#include "repository/faces/coverage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace repository {
namespace {

base::Image filled(int width, int height, std::uint8_t value) {
  base::Image mask(width, height, 1);
  std::fill(mask.pixels.begin(), mask.pixels.end(), value);
  return mask;
}

base::Image noise(int width, int height, unsigned seed, unsigned percent) {
  base::Image mask(width, height, 1);
  std::mt19937 random(seed);
  for (std::uint8_t& pixel : mask.pixels) pixel = random() % 100 < percent ? 255 : 0;
  return mask;
}

// Discs of model, some of them with a hole, stand for silhouettes.
base::Image blobs(int width, int height, unsigned seed, int count) {
  base::Image mask(width, height, 1);
  std::mt19937 random(seed);
  for (int i = 0; i < count; ++i) {
    const int cx = static_cast<int>(random() % static_cast<unsigned>(width));
    const int cy = static_cast<int>(random() % static_cast<unsigned>(height));
    const int radius = 2 + static_cast<int>(random() % static_cast<unsigned>(std::max(1, width / 4)));
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const int square = (x - cx) * (x - cx) + (y - cy) * (y - cy);
        if (square < radius * radius) *mask.at(x, y) = square * 9 < radius * radius ? 0 : 255;
      }
    }
  }
  return mask;
}

void expectRoundTrip(const base::Image& mask) {
  const base::Bytes bytes = encodeCoverage(mask);
  const auto back = decodeCoverage(bytes, mask.width, mask.height);
  ASSERT_TRUE(back) << back.error().message;
  ASSERT_EQ(back->channels, 1);
  for (std::size_t i = 0; i < mask.pixels.size(); ++i) ASSERT_EQ(back->pixels[i], mask.pixels[i] != 0 ? 255 : 0) << i;
}

TEST(Coverage, masksOfEverySmallSizeComeBack) {
  for (int height = 1; height <= 19; ++height) {
    for (int width = 1; width <= 19; ++width) {
      expectRoundTrip(noise(width, height, static_cast<unsigned>(100 * height + width), 50));
      expectRoundTrip(filled(width, height, 0));
      expectRoundTrip(filled(width, height, 255));
    }
  }
}

TEST(Coverage, noiseOfEveryDensityComesBack) {
  for (const unsigned percent : {0U, 1U, 10U, 50U, 90U, 99U, 100U})
    expectRoundTrip(noise(203, 151, percent + 1, percent));
}

TEST(Coverage, silhouettesComeBack) {
  for (unsigned seed = 0; seed < 20; ++seed) expectRoundTrip(blobs(257, 131, seed, 6));
}

TEST(Coverage, valuesOtherThan255CountAsModel) {
  base::Image mask = filled(9, 9, 0);
  *mask.at(4, 4) = 1;
  expectRoundTrip(mask);
}

TEST(Coverage, longRunsOfCarriesComeBack) {
  // Sparse single pixels among zeros drive low_ towards all ones, where carries run through waiting bytes.
  for (unsigned seed = 0; seed < 30; ++seed) {
    base::Image mask = filled(512, 64, 0);
    std::mt19937 random(seed);
    for (int i = 0; i < 40; ++i) mask.pixels[random() % mask.pixels.size()] = 255;
    expectRoundTrip(mask);
  }
}

TEST(Coverage, aFullMaskIsNoBytesAndAnEmptyOneFew) {
  EXPECT_TRUE(encodeCoverage(filled(512, 512, 255)).empty());
  EXPECT_LE(encodeCoverage(filled(512, 512, 0)).size(), 16U);
}

TEST(Coverage, aSilhouetteCostsFarLessThanItsRawBits) {
  const base::Image mask = blobs(512, 512, 4, 5);
  EXPECT_LT(encodeCoverage(mask).size(), 1500U);  // 32768 raw
}

TEST(Coverage, noiseCostsHardlyMoreThanItsRawBits) {
  EXPECT_LT(encodeCoverage(noise(512, 512, 9, 50)).size(), 32768U * 104 / 100);
}

TEST(Coverage, theSameMaskGivesTheSameBytes) {
  EXPECT_EQ(encodeCoverage(blobs(100, 100, 3, 4)), encodeCoverage(blobs(100, 100, 3, 4)));
}

TEST(Coverage, everyTruncationIsRefused) {
  for (const base::Image& mask : {blobs(64, 64, 1, 3), filled(64, 64, 0), noise(31, 17, 2, 50), noise(1, 1, 1, 0)}) {
    const base::Bytes bytes = encodeCoverage(mask);
    for (std::size_t size = 1; size < bytes.size(); ++size) {
      EXPECT_FALSE(decodeCoverage(base::ByteView(bytes).first(size), mask.width, mask.height))
          << size << " of " << bytes.size();
    }
  }
}

TEST(Coverage, bytesLeftOverAreRefused) {
  base::Bytes bytes = encodeCoverage(blobs(64, 64, 1, 3));
  bytes.push_back(0);
  EXPECT_FALSE(decodeCoverage(bytes, 64, 64));
}

TEST(Coverage, anotherVersionIsAVersionError) {
  base::Bytes bytes = encodeCoverage(filled(8, 8, 0));
  bytes[0] = 2;
  const auto mask = decodeCoverage(bytes, 8, 8);
  ASSERT_FALSE(mask);
  EXPECT_EQ(mask.error().code, base::ErrorCode::kVersion);
}

TEST(Coverage, randomBytesNeverCrash) {
  std::mt19937 random(11);
  for (int i = 0; i < 2000; ++i) {
    base::Bytes bytes(random() % 200);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    if (!bytes.empty()) bytes[0] = 1;
    const int width = 1 + static_cast<int>(random() % 70);
    const int height = 1 + static_cast<int>(random() % 70);
    const auto mask = decodeCoverage(bytes, width, height);
    if (mask) {
      EXPECT_EQ(mask->pixels.size(), static_cast<std::size_t>(width * height));
    }
  }
}

TEST(Coverage, aFewBytesOfTheLargestMaskAreRefusedAtOnce) {
  EXPECT_FALSE(decodeCoverage(base::Bytes{1, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF}, 16384, 16384));
}

// These bytes of version 1 hold a disc of radius 5 in 16 × 16 pixels. They must stay readable.
TEST(Coverage, bytesOfVersionOneStay) {
  base::Image mask(16, 16, 1);
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) *mask.at(x, y) = (x - 7) * (x - 7) + (y - 8) * (y - 8) <= 25 ? 255 : 0;
  }
  const base::Bytes stored = {0x01, 0xCB, 0x54, 0x0B, 0x08, 0x13, 0x54, 0xDD, 0x27, 0x83, 0x54,
                              0x8E, 0x8C, 0x36, 0x3B, 0x4D, 0xEF, 0x60, 0x00, 0x00, 0x00};
  EXPECT_EQ(encodeCoverage(mask), stored);
  const auto back = decodeCoverage(stored, 16, 16);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->pixels, mask.pixels);
}

}  // namespace
}  // namespace repository
