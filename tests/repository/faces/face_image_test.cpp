#include "repository/faces/face_image.h"

#include <gtest/gtest.h>

#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"

namespace repository {
namespace {

constexpr int kWidth = 24;
constexpr int kHeight = 16;

// Returns a red picture. With `masked` the left third is background; otherwise all of it is model.
base::Bytes face(bool masked) {
  base::Image rgb(kWidth, kHeight, 3);
  base::Image mask(kWidth, kHeight, 1);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      rgb.at(x, y)[0] = 200;
      mask.at(x, y)[0] = masked && x < 8 ? 0 : 255;
    }
  const base::Bytes jpeg = *base::encodeJpeg(rgb, 95, base::Subsampling::k444);
  const base::Bytes coverage = encodeCoverage(mask);
  EXPECT_EQ(coverage.empty(), !masked);
  return encodeFaceValue({false, jpeg, coverage});
}

TEST(FaceImage, alphaIsTheMaskAndColourIsWhatTheJpegHolds) {
  for (const bool masked : {true, false}) {
    const auto image = decodeFaceImage(face(masked), 0);
    ASSERT_TRUE(image) << image.error().message;
    ASSERT_EQ(image->width, kWidth);
    ASSERT_EQ(image->height, kHeight);
    ASSERT_EQ(image->channels, 4);
    for (int x = 0; x < kWidth; ++x) {
      EXPECT_NEAR(image->at(x, 5)[0], 200, 2) << x;
      EXPECT_NEAR(image->at(x, 5)[1], 0, 2) << x;
      EXPECT_EQ(image->at(x, 5)[3], masked && x < 8 ? 0 : 255) << x;
    }
  }
}

TEST(FaceImage, anEmptyFlagGivesAnEmptyImage) {
  EXPECT_TRUE(decodeFaceImage(encodeFaceValue({}), 16)->empty());
  const auto pixels = decodeFacePixels(encodeFaceValue({}), 16);
  ASSERT_TRUE(pixels);
  EXPECT_TRUE(pixels->rgb.empty() && pixels->mask.empty());
}

TEST(FaceImage, anotherSizeIsRefusedByName) {
  for (const int side : {kHeight, kWidth, 512}) {
    const auto image = decodeFaceImage(face(true), side);
    ASSERT_FALSE(image) << side;
    EXPECT_NE(image.error().message.find(side < kWidth ? "side" : "24 x 16 pixels, not"), std::string::npos)
        << image.error().message;
  }
}

TEST(FaceImage, everyTruncationIsAnError) {
  const base::Bytes whole = face(true);
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_FALSE(decodeFaceImage(base::ByteView(whole).first(size), 0)) << size;
}

TEST(FaceImage, aBrokenMaskIsAnError) {
  const base::Bytes jpeg = *base::encodeJpeg(base::Image(16, 16, 3), 80, base::Subsampling::k420);
  EXPECT_FALSE(decodeFaceImage(encodeFaceValue({false, jpeg, base::Bytes{1, 2, 3}}), 16));
}

}  // namespace
}  // namespace repository
