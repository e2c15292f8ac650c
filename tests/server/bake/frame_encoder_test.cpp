#include "server/bake/frame_encoder.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "base/picture_error.h"
#include "base/view_defaults.h"
#include "repository/faces/face_value.h"
#include "repository/faces/frame_image.h"
#include "repository/faces/webp.h"

namespace server {
namespace {

using protocol::FrameCodec;
constexpr std::int64_t kMaxPixels = 1'000'000;

/// A bright square on transparent black, as the renderer leaves it; a quarter of each pixel of its rim is covered.
base::Image square() {
  base::Image image(64, 48, 4);
  for (int y = 11; y < 37; ++y)
    for (int x = 19; x < 45; ++x) {
      const bool inside = y > 11 && y < 36 && x > 19 && x < 44;
      std::uint8_t* pixel = image.at(x, y);
      pixel[0] = 230, pixel[1] = static_cast<std::uint8_t>(150 + x), pixel[2] = 60, pixel[3] = inside ? 255 : 64;
    }
  return image;
}

base::Image decoded(const base::Bytes& value) {
  auto image = repository::decodeFrameImage(value, kMaxPixels);
  EXPECT_TRUE(image) << image.error().message;
  return image ? std::move(*image) : base::Image();
}

TEST(FrameEncoder, webpKeepsSmoothEdgesAndJpegRoundsThem) {
  const base::Image image = square();
  const base::Image webp = decoded(encodeFrame(image, FrameCodec::kWebp, protocol::kServersChoice)->value);
  const base::Image jpeg = decoded(encodeFrame(image, FrameCodec::kJpeg, protocol::kServersChoice)->value);
  for (std::size_t i = 3; i < image.pixels.size(); i += 4) {
    ASSERT_EQ(webp.pixels[i], image.pixels[i]) << i;
    ASSERT_EQ(jpeg.pixels[i], image.pixels[i] == 255 ? 255 : 0) << i;
  }
}

TEST(FrameEncoder, theBackgroundDarkensNeitherTheRimNorThePixelsBesideIt) {
  const base::Image image = square();
  for (const FrameCodec codec : {FrameCodec::kWebp, FrameCodec::kJpeg}) {
    const base::Image back = decoded(encodeFrame(image, codec, protocol::kServersChoice)->value);
    for (int y = 10; y < 38; ++y)
      for (const int x : {18, 19, 20, 43, 44, 45}) EXPECT_GT(back.at(x, y)[0], 200) << x << ' ' << y;
  }
}

TEST(FrameEncoder, aViewOfNothingIsAnEmptyFlag) {
  for (const FrameCodec codec : {FrameCodec::kWebp, FrameCodec::kJpeg})
    EXPECT_TRUE(repository::decodeFaceValue(encodeFrame(base::Image(30, 20, 4), codec, 80)->value)->empty);
}

TEST(FrameEncoder, aQualityThatIsAskedForHolds) {
  const base::Image image = square();
  for (const FrameCodec codec : {FrameCodec::kWebp, FrameCodec::kJpeg}) {
    const base::Bytes coarse = encodeFrame(image, codec, 5)->value;
    const base::Bytes fine = encodeFrame(image, codec, 100)->value;
    EXPECT_LT(coarse.size(), fine.size());
    EXPECT_LT(base::foregroundError(image, decoded(fine)).squared,
              base::foregroundError(image, decoded(coarse)).squared);
  }
}

TEST(FrameEncoder, tellsTheErrorThatWebpMakes) {
  const base::Image image = square();
  const auto error = [&](FrameCodec codec, int quality) { return encodeFrame(image, codec, quality)->coding_error; };
  EXPECT_GT(error(FrameCodec::kWebp, 5), 1.2F * error(FrameCodec::kWebp, 90));
  EXPECT_GT(error(FrameCodec::kWebp, 90), 0.0F);
  EXPECT_EQ(error(FrameCodec::kWebp, base::ViewDefaults::kWithoutLoss), 0.0F);
  EXPECT_EQ(error(FrameCodec::kJpeg, 5), 0.0F) << "not told";
}

TEST(FrameEncoder, withoutLossEveryPixelOfTheModelComesBackAsItIs) {
  base::Image noisy(90, 70, 4);
  std::uint32_t state = 7;
  for (std::size_t i = 0; i < noisy.pixels.size(); ++i) {
    state = 1664525U * state + 1013904223U;
    noisy.pixels[i] = static_cast<std::uint8_t>(state >> 24);
    if (i % 4 == 3 && noisy.pixels[i] < 100) noisy.pixels[i] = i % 8 == 3 ? 0 : 255;
  }
  const base::Image back = decoded(encodeFrame(noisy, FrameCodec::kWebp, base::ViewDefaults::kWithoutLoss)->value);
  ASSERT_EQ(back.pixels.size(), noisy.pixels.size());
  for (std::size_t i = 0; i < noisy.pixels.size(); i += 4) {
    ASSERT_EQ(back.pixels[i + 3], noisy.pixels[i + 3]) << i;
    for (std::size_t c = 0; noisy.pixels[i + 3] > 0 && c < 3; ++c) ASSERT_EQ(back.pixels[i + c], noisy.pixels[i + c]);
  }
}

TEST(FrameEncoder, withoutLossThereIsNoJpegSoItHasItsDefault) {
  const base::Image image = square();
  EXPECT_EQ(encodeFrame(image, FrameCodec::kJpeg, base::ViewDefaults::kWithoutLoss)->value,
            encodeFrame(image, FrameCodec::kJpeg, protocol::kServersChoice)->value);
}

// 9 million pixels of noise take 27 MB without loss, and a message has 16 MiB at most.
TEST(FrameEncoder, aPictureTooLargeForAMessageWithoutLossHasTheDefaultQuality) {
  base::Image noisy(3000, 3000, 4);
  std::uint32_t state = 7;
  for (std::size_t i = 0; i < noisy.pixels.size(); ++i) {
    state = 1664525U * state + 1013904223U;
    noisy.pixels[i] = i % 4 == 3 ? 255 : static_cast<std::uint8_t>(state >> 24);
  }
  const base::Bytes value = encodeFrame(noisy, FrameCodec::kWebp, base::ViewDefaults::kWithoutLoss)->value;
  EXPECT_LE(value.size(), protocol::kMaxPayload);
  EXPECT_EQ(value, encodeFrame(noisy, FrameCodec::kWebp, protocol::kServersChoice)->value);
}

TEST(FrameEncoder, aSideLongerThanWebpAllowsIsSentAsJpeg) {
  base::Image wide(repository::kMaxWebpSide, 1, 4);
  for (std::size_t i = 3; i < wide.pixels.size(); i += 4) wide.pixels[i] = 255;
  const auto isWebpFrame = [](const base::Image& image) {
    const base::Bytes value = encodeFrame(image, FrameCodec::kWebp, protocol::kServersChoice)->value;
    return repository::isWebp(repository::decodeFaceValue(value)->picture);
  };
  EXPECT_TRUE(isWebpFrame(wide));
  base::Image wider(repository::kMaxWebpSide + 1, 1, 4);
  for (std::size_t i = 3; i < wider.pixels.size(); i += 4) wider.pixels[i] = 255;
  EXPECT_FALSE(isWebpFrame(wider));
}

}  // namespace
}  // namespace server
