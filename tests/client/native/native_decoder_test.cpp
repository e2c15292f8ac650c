#include "client/native/native_decoder.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <map>
#include <thread>

#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/faces/webp.h"

namespace client {
namespace {

/// A face of 16 × 16 pixels: the left half is red and covered, the right half background.
base::Bytes halfCovered() {
  base::Image rgb(16, 16, 3);
  base::Image mask(16, 16, 1);
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) {
      rgb.at(x, y)[0] = 200;
      mask.at(x, y)[0] = x < 8 ? 255 : 0;
    }
  const base::Bytes jpeg = *base::encodeJpeg(rgb, 90, base::Subsampling::k444);
  const base::Bytes coverage = repository::encodeCoverage(mask);
  return repository::encodeFaceValue({.empty = false, .picture = jpeg, .coverage = coverage});
}

std::map<std::uint64_t, ImageDecoder::DecodedImage> takeAll(ImageDecoder& decoder) {
  std::map<std::uint64_t, ImageDecoder::DecodedImage> all;
  while (decoder.pending() > 0) {
    for (auto& decoded : decoder.takeDecoded()) all[decoded.id] = std::move(decoded);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return all;
}

TEST(NativeDecoder, alphaIsCoverageAndColourIsNotPremultiplied) {
  const auto decoded = decodeFaceImage(7, halfCovered());
  EXPECT_EQ(decoded.id, 7U);
  ASSERT_TRUE(decoded.error.empty()) << decoded.error;
  ASSERT_EQ(decoded.rgba.channels, 4);
  EXPECT_EQ(decoded.rgba.at(2, 5)[3], 255);
  EXPECT_EQ(decoded.rgba.at(12, 5)[3], 0);
  EXPECT_NEAR(decoded.rgba.at(12, 5)[0], 200, 6);
}

TEST(NativeDecoder, withoutAMaskEveryPixelIsModel) {
  base::Image rgb(8, 8, 3);
  const base::Bytes jpeg = *base::encodeJpeg(rgb, 90, base::Subsampling::k420);
  const auto decoded =
      decodeFaceImage(1, repository::encodeFaceValue({.empty = false, .picture = jpeg, .coverage = {}}));
  ASSERT_FALSE(decoded.rgba.empty()) << decoded.error;
  for (int i = 0; i < 64; ++i) EXPECT_EQ(decoded.rgba.pixels[static_cast<std::size_t>(4 * i + 3)], 255);
}

TEST(NativeDecoder, aFrameInWebpKeepsItsAlpha) {
  base::Image rgba(8, 8, 4);
  for (std::size_t i = 3; i < rgba.pixels.size(); i += 4) rgba.pixels[i] = 96;
  const base::Bytes webp = *repository::encodeWebp(rgba, 90);
  const auto decoded =
      decodeFaceImage(1, repository::encodeFaceValue({.empty = false, .picture = webp, .coverage = {}}));
  ASSERT_FALSE(decoded.rgba.empty()) << decoded.error;
  EXPECT_EQ(decoded.rgba.at(4, 4)[3], 96);
}

TEST(NativeDecoder, anEmptyFlagGivesNoImageAndNoError) {
  const auto decoded = decodeFaceImage(1, repository::encodeFaceValue({}));
  EXPECT_TRUE(decoded.rgba.empty());
  EXPECT_TRUE(decoded.error.empty());
}

TEST(NativeDecoder, everyTruncationIsAnError) {
  const base::Bytes whole = halfCovered();
  for (std::size_t length = 0; length < whole.size(); length += 7) {
    const auto decoded = decodeFaceImage(1, base::ByteView(whole).first(length));
    EXPECT_TRUE(decoded.rgba.empty());
    EXPECT_FALSE(decoded.error.empty());
  }
}

TEST(NativeDecoder, manyImagesComeBackUnderTheirNumbers) {
  NativeDecoder decoder(3);
  const base::Bytes good = halfCovered();
  const base::Bytes empty = repository::encodeFaceValue({});
  for (std::uint64_t id = 0; id < 60; ++id)
    decoder.submit(id, id % 3 == 0 ? good : id % 3 == 1 ? empty : base::Bytes{1, 2});
  const auto all = takeAll(decoder);
  ASSERT_EQ(all.size(), 60U);
  for (const auto& [id, decoded] : all) {
    EXPECT_EQ(!decoded.rgba.empty(), id % 3 == 0) << id;
    EXPECT_EQ(!decoded.error.empty(), id % 3 == 2) << id;
  }
}

TEST(NativeDecoder, theBytesMayGoOnceTheyAreSubmitted) {
  NativeDecoder decoder(1);
  {
    base::Bytes value = halfCovered();
    decoder.submit(1, value);
    std::fill(value.begin(), value.end(), std::uint8_t{0});
  }
  EXPECT_TRUE(takeAll(decoder).at(1).error.empty());
}

}  // namespace
}  // namespace client
