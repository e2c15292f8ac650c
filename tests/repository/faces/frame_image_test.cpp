#include "repository/faces/frame_image.h"

#include <gtest/gtest.h>

#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"
#include "repository/faces/webp.h"

namespace repository {
namespace {

constexpr std::int64_t kMaxPixels = 1'000'000;

/// Red, a quarter covered.
base::Image translucent() {
  base::Image image(24, 16, 4);
  for (std::size_t i = 0; i < image.pixels.size(); i += 4) {
    image.pixels[i] = 200;
    image.pixels[i + 3] = 64;
  }
  return image;
}

base::Bytes webpValue(base::ByteView coverage = {}) {
  const base::Bytes webp = *encodeWebp(translucent(), 90);
  return encodeFaceValue({.empty = false, .picture = webp, .coverage = coverage});
}

TEST(FrameImage, webpKeepsItsAlphaAndIsNotPremultiplied) {
  const auto image = decodeFrameImage(webpValue(), kMaxPixels);
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->width, 24);
  EXPECT_EQ(image->at(5, 5)[3], 64);
  EXPECT_NEAR(image->at(5, 5)[0], 200, 4);
}

TEST(FrameImage, webpIsToldByItsFirstBytes) {
  const base::Bytes webp = *encodeWebp(translucent(), 90);
  EXPECT_TRUE(isWebp(webp));
  EXPECT_FALSE(isWebp(base::ByteView(webp).first(11)));
  EXPECT_FALSE(isWebp(*base::encodeJpeg(base::Image(16, 16, 3), 90, base::Subsampling::k444)));
}

TEST(FrameImage, aFaceDecodesAsAFace) {
  base::Image mask(16, 16, 1);
  *mask.at(3, 3) = 255;
  const base::Bytes jpeg = *base::encodeJpeg(base::Image(16, 16, 3), 90, base::Subsampling::k444);
  const base::Bytes coverage = encodeCoverage(mask);
  const base::Bytes value = encodeFaceValue({.empty = false, .picture = jpeg, .coverage = coverage});
  EXPECT_EQ(decodeFrameImage(value, kMaxPixels)->pixels, decodeFaceImage(value, 16)->pixels);
  EXPECT_TRUE(decodeFrameImage(encodeFaceValue({}), kMaxPixels)->empty());
}

TEST(FrameImage, aStoredFaceMayBeWebpOfItsSizeAlone) {
  const auto image = decodeFaceImage(webpValue(), 0);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->pixels, decodeFrameImage(webpValue(), kMaxPixels)->pixels);
  EXPECT_FALSE(decodeFaceImage(webpValue(), 16)) << "it is no square of 16";
  EXPECT_FALSE(decodeFaceImage(webpValue(base::Bytes{1, 2, 3}), 0)) << "a mask beside its alpha";
}

TEST(FrameImage, aMaskBesideAlphaIsRefused) {
  const auto image = decodeFrameImage(webpValue(base::Bytes{1, 2, 3}), kMaxPixels);
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().message, "WebP: a mask comes with it, though it holds alpha itself");
}

TEST(FrameImage, tooManyPixelsAreRefused) {
  EXPECT_TRUE(decodeFrameImage(webpValue(), 24 * 16));
  EXPECT_FALSE(decodeFrameImage(webpValue(), 24 * 16 - 1));
}

}  // namespace
}  // namespace repository
