#include "repository/faces/webp.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace repository {
namespace {

constexpr std::int64_t kMaxPixels = 1'000'000;

/// Smooth colours; alpha falls from left to right, 0 at the last eight columns.
base::Image fading(int width, int height) {
  base::Image image(width, height, 4);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      std::uint8_t* pixel = image.at(x, y);
      pixel[0] = static_cast<std::uint8_t>(127.0 + 100.0 * std::sin(0.05 * x));
      pixel[1] = static_cast<std::uint8_t>(127.0 + 100.0 * std::cos(0.04 * y));
      pixel[2] = 90;
      pixel[3] = static_cast<std::uint8_t>(x >= width - 8 ? 0 : 255 - 255 * x / width);
    }
  return image;
}

int largestDifference(const base::Image& a, const base::Image& b, int channel) {
  int largest = 0;
  for (std::size_t i = static_cast<std::size_t>(channel); i < a.pixels.size(); i += 4)
    largest = std::max(largest, std::abs(int{a.pixels[i]} - int{b.pixels[i]}));
  return largest;
}

TEST(Webp, coloursComeBackNearlyTheSameAndAlphaExactly) {
  const base::Image image = fading(120, 70);
  const auto bytes = encodeWebp(image, 92);
  ASSERT_TRUE(bytes) << bytes.error().message;
  const auto back = decodeWebp(*bytes, kMaxPixels);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->width, 120);
  EXPECT_EQ(back->height, 70);
  EXPECT_EQ(largestDifference(image, *back, 3), 0);
  for (int channel = 0; channel < 3; ++channel) EXPECT_LE(largestDifference(image, *back, channel), 12) << channel;
}

TEST(Webp, coloursUnderNoCoverageStay) {
  const base::Image image = fading(64, 32);
  const auto back = decodeWebp(*encodeWebp(image, 92), kMaxPixels);
  ASSERT_TRUE(back);
  ASSERT_EQ(back->at(62, 10)[3], 0);
  EXPECT_NEAR(back->at(62, 10)[0], image.at(62, 10)[0], 8);
  EXPECT_NEAR(back->at(62, 10)[1], image.at(62, 10)[1], 8);
}

// The encoder's account leaves out what half as many pixels of chroma take away.
TEST(Webp, theErrorThatIsToldIsThatOfThePictureWhereItIsNotTransparent) {
  base::Image image(160, 120, 4);
  for (int y = 0; y < 120; ++y)
    for (int x = 0; x < 160; ++x) {
      std::uint8_t* p = image.at(x, y);
      const double wave = std::sin(0.9 * x) * std::sin(0.7 * y);
      for (int c = 0; c < 3; ++c) p[c] = static_cast<std::uint8_t>(128.0 + 90.0 * wave);
      p[3] = x < 80 ? 255 : 0;
      if (p[3] == 0) p[0] = p[1] = p[2] = 90;
    }
  float last = 1.0F;
  for (const int quality : {10, 40, 80}) {
    float told = 0.0F;
    const auto bytes = encodeWebp(image, quality, &told);
    ASSERT_TRUE(bytes);
    const base::Image back = *decodeWebp(*bytes, kMaxPixels);
    double sum = 0.0;
    for (int y = 0; y < 120; ++y)
      for (int x = 0; x < 80; ++x)
        for (int c = 0; c < 3; ++c) sum += std::pow(double{1.0} * image.at(x, y)[c] - back.at(x, y)[c], 2.0);
    const double error = std::sqrt(sum / (3.0 * 80.0 * 120.0)) / 255.0;
    EXPECT_NEAR(told / error, 1.0, 0.15) << quality;
    EXPECT_LT(told, last);
    EXPECT_EQ(*bytes, *encodeWebp(image, quality)) << "asking changes nothing";
    last = told;
  }
}

TEST(Webp, higherQualityCostsBytes) {
  const base::Image image = fading(256, 256);
  EXPECT_LT(encodeWebp(image, 30)->size(), encodeWebp(image, 95)->size());
}

TEST(Webp, everyTruncationIsAnError) {
  const base::Bytes whole = *encodeWebp(fading(40, 30), 60);
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_FALSE(decodeWebp(base::ByteView(whole).first(size), kMaxPixels)) << size;
}

TEST(Webp, aPictureOverTheLimitIsRefusedWithBothSizes) {
  const base::Bytes whole = *encodeWebp(fading(40, 30), 60);
  EXPECT_TRUE(decodeWebp(whole, 1200));
  const auto refused = decodeWebp(whole, 1199);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, "WebP: 40 x 30 pixels; at most 1199 are taken");
}

TEST(Webp, picturesThatTheFormatCannotHoldAreRefused) {
  EXPECT_FALSE(encodeWebp(base::Image(0, 0, 4), 80));
  EXPECT_FALSE(encodeWebp(base::Image(kMaxWebpSide + 1, 1, 4), 80));
  EXPECT_TRUE(encodeWebp(base::Image(kMaxWebpSide, 1, 4), 80));
}

}  // namespace
}  // namespace repository
