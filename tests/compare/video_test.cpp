// Tests the codec of the method `video`: bytes and pictures that do not depend on the machine, at the rate asked for.
#include "compare/sim/video_codec.h"

#include <gtest/gtest.h>

#include <cmath>

namespace {

/// A smooth picture that moves to the right, frame by frame.
base::Image pictureAt(int frame, int width, int height) {
  base::Image rgb(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double wave = std::sin(0.1 * (x - 3 * frame)) * std::cos(0.07 * y);
      for (int c = 0; c < 3; ++c) rgb.at(x, y)[c] = static_cast<std::uint8_t>(128.0 + (60.0 + 20.0 * c) * wave);
    }
  return rgb;
}

/// Noise, which no rate suffices for.
base::Image noiseAt(std::uint32_t frame, int width, int height) {
  base::Image rgb(width, height, 3);
  std::uint32_t state = 7919 * (frame + 1);
  for (std::uint8_t& value : rgb.pixels) {
    state = state * 1664525U + 1013904223U;
    value = static_cast<std::uint8_t>(state >> 24U);
  }
  return rgb;
}

double psnrOf(const base::Image& a, const base::Image& b) {
  double squares = 0.0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    const double difference = static_cast<double>(a.pixels[i]) - b.pixels[i];
    squares += difference * difference;
  }
  return 10.0 * std::log10(255.0 * 255.0 * static_cast<double>(a.pixels.size()) / squares);
}

TEST(Video, showsEachPictureAtOnceAndClosely) {
  for (const auto& [width, height] : {std::pair{320, 180}, std::pair{321, 181}}) {
    auto encoder = compare::VideoEncoder::create({width, height, 30, 4e6});
    ASSERT_TRUE(encoder) << encoder.error().message;
    auto decoder = compare::VideoDecoder::create(width, height);
    ASSERT_TRUE(decoder) << decoder.error().message;
    for (int frame = 0; frame < 10; ++frame) {
      const base::Image picture = pictureAt(frame, width, height);
      const auto coded = (*encoder)->encode(*compare::toVideoInput(picture));
      ASSERT_TRUE(coded) << coded.error().message;
      const auto shown = (*decoder)->decode(*coded);
      ASSERT_TRUE(shown) << shown.error().message;
      ASSERT_EQ(shown->pixels.size(), picture.pixels.size());
      EXPECT_GT(psnrOf(picture, *shown), 35.0) << frame;
      // The picture of another instant would be far off.
      if (frame > 0) {
        EXPECT_LT(psnrOf(pictureAt(frame - 1, width, height), *shown), 28.0) << frame;
      }
    }
  }
}

TEST(Video, keepsToItsRateWhateverThePictures) {
  for (const double rate : {384e3, 4e6}) {
    auto encoder = compare::VideoEncoder::create({320, 180, 30, rate});
    ASSERT_TRUE(encoder) << encoder.error().message;
    double bits = 0.0;
    constexpr std::uint32_t kFrames = 90;
    for (std::uint32_t frame = 0; frame < kFrames; ++frame)
      bits += 8.0 * static_cast<double>((*encoder)->encode(*compare::toVideoInput(noiseAt(frame, 320, 180)))->size());
    EXPECT_LT(bits / (kFrames / 30.0), 1.1 * rate);
    EXPECT_GT(bits / (kFrames / 30.0), 0.7 * rate);
  }
}

TEST(Video, hasTheSameBytesEachTime) {
  const auto bytesOf = [] {
    auto encoder = compare::VideoEncoder::create({160, 90, 30, 1e6});
    base::Bytes all;
    for (int frame = 0; frame < 5; ++frame) {
      const auto coded = *(*encoder)->encode(*compare::toVideoInput(pictureAt(frame, 160, 90)));
      all.insert(all.end(), coded.begin(), coded.end());
    }
    return all;
  };
  const base::Bytes first = bytesOf();
  EXPECT_GT(first.size(), 100U);
  EXPECT_EQ(first, bytesOf());
}

TEST(Video, refusesBytesThatAreNone) {
  auto decoder = compare::VideoDecoder::create(160, 90);
  ASSERT_TRUE(decoder);
  EXPECT_FALSE((*decoder)->decode(base::Bytes(100, 42)));
}

}  // namespace
