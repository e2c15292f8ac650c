#include "server/bake/face_encoder.h"

#include <gtest/gtest.h>

#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"

namespace server {
namespace {

void paint(base::Image& image, int x, int y, std::uint8_t r, std::uint8_t g, std::uint8_t b, std::uint8_t a) {
  std::uint8_t* pixel = image.at(x, y);
  pixel[0] = r, pixel[1] = g, pixel[2] = b, pixel[3] = a;
}

// Draws a disc of one colour on nothing, half covered on its rim.
base::Image disc(int side, int radius) {
  base::Image image(side, side, 4);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const int square = (x - side / 2) * (x - side / 2) + (y - side / 2) * (y - side / 2);
      if (square < radius * radius) paint(image, x, y, 200, static_cast<std::uint8_t>(100 + x % 20), 40, 255);
    }
  }
  return image;
}

TEST(FaceEncoder, aFaceThatSeesNothingIsAnEmptyFlag) {
  base::Image image(64, 64, 4);
  paint(image, 3, 3, 255, 255, 255, kStoredCoverage - 1);  // less than a sixteenth of a pixel is nothing
  const auto face = encodeImage(image, 85, base::Subsampling::k420);
  ASSERT_TRUE(face);
  EXPECT_TRUE(face->empty);
  EXPECT_EQ(face->value.size(), 8U);
  EXPECT_TRUE(repository::decodeFaceValue(face->value)->empty);
}

TEST(FaceEncoder, onePixelOfModelIsAnImage) {
  base::Image image(64, 64, 4);
  paint(image, 3, 3, 255, 255, 255, kStoredCoverage);
  const auto face = encodeImage(image, 85, base::Subsampling::k420);
  ASSERT_TRUE(face);
  EXPECT_FALSE(face->empty);
  const auto value = repository::decodeFaceValue(face->value);
  const auto mask = repository::decodeCoverage(value->coverage, 64, 64);
  ASSERT_TRUE(mask);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) EXPECT_EQ(*mask->at(x, y), x == 3 && y == 3 ? 255 : 0);
  }
}

TEST(FaceEncoder, modelPixelsComeBackNearTheirColours) {
  const base::Image image = disc(128, 40);
  const auto face = encodeImage(image, 90, base::Subsampling::k420);
  const auto value = repository::decodeFaceValue(face->value);
  const auto picture = base::decodeJpeg(value->picture);
  const auto mask = repository::decodeCoverage(value->coverage, 128, 128);
  ASSERT_TRUE(picture && mask);
  double sum = 0.0;
  int count = 0;
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      ASSERT_EQ(*mask->at(x, y) != 0, image.at(x, y)[3] != 0);
      if (*mask->at(x, y) == 0) continue;
      for (int c = 0; c < 3; ++c) sum += std::abs(int{picture->at(x, y)[c]} - int{image.at(x, y)[c]});
      count += 3;
    }
  }
  EXPECT_LT(sum / count, 4.0);
}

TEST(FaceEncoder, aPictureFullOfModelHasNoMask) {
  base::Image image(32, 32, 4);
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) paint(image, x, y, 10, 20, 30, 255);
  }
  const auto face = encodeImage(image, 85, base::Subsampling::k420);
  ASSERT_TRUE(face);
  EXPECT_EQ(face->coverage_bytes, 0U);
  EXPECT_EQ(face->value.size(), 16 + face->jpeg_bytes);
}

TEST(FaceEncoder, anotherAlphaLeavesColoursAndFillsGaps) {
  const base::Image image = disc(64, 20);
  base::Image alpha(64, 64, 1);
  for (const std::uint8_t rest : {std::uint8_t{0}, std::uint8_t{77}}) {
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) *alpha.at(x, y) = image.at(x, y)[3] != 0 ? 200 : rest;
    const base::Image result = withAlpha(image, alpha);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x) {
        EXPECT_EQ(result.at(x, y)[3], *alpha.at(x, y));
        const bool is_own = std::equal(result.at(x, y), result.at(x, y) + 3, image.at(x, y));
        EXPECT_EQ(is_own, *alpha.at(x, y) != 0) << x << ", " << y;
      }
  }
}

TEST(FaceEncoder, fillerCostsAJpegLessThanBlackBackground) {
  const base::Image image = disc(256, 80);
  base::Image black(256, 256, 3);
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) std::copy_n(image.at(x, y), 3, black.at(x, y));
  }
  const auto filled = encodeImage(image, 85, base::Subsampling::k420);
  EXPECT_LT(filled->jpeg_bytes * 10, base::encodeJpeg(black, 85, base::Subsampling::k420)->size() * 9);
}

TEST(FaceEncoder, sidesThatAreNoMultipleOfABlockWork) {
  for (const int side : {1, 7, 9, 33}) {
    base::Image image(side, side, 4);
    paint(image, side - 1, side - 1, 1, 2, 3, 255);
    const auto face = encodeImage(image, 85, base::Subsampling::k422);
    ASSERT_TRUE(face);
    const auto picture = base::decodeJpeg(repository::decodeFaceValue(face->value)->picture);
    ASSERT_TRUE(picture);
    EXPECT_EQ(picture->width, side);
  }
}

TEST(FaceEncoder, theSamePictureGivesTheSameBytes) {
  EXPECT_EQ(encodeImage(disc(100, 30), 85, base::Subsampling::k420)->value,
            encodeImage(disc(100, 30), 85, base::Subsampling::k420)->value);
}

}  // namespace
}  // namespace server
