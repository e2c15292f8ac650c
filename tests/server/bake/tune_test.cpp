#include "server/bake/tune.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>

#include "repository/faces/filler.h"
#include "server/bake/face_encoder.h"

namespace server {
namespace {

using base::Subsampling;

constexpr std::array kAll = {Subsampling::k420, Subsampling::k422, Subsampling::k444};

struct Look {
  double luma = 30.0;    ///< amplitude of waves that all three colours share
  double chroma = 10.0;  ///< … of waves in which red goes up where blue goes down
  double noise = 4.0;
};

// Draws a disc of waves on nothing; `seed` decides where it lies, its waves and its noise.
base::Image waves(unsigned seed, const Look& look) {
  constexpr int kSide = 64;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const double cx = 20.0 + 24.0 * unit(random);
  const double cy = 20.0 + 24.0 * unit(random);
  const double radius = 12.0 + 20.0 * unit(random);
  const double pace = 0.3 + unit(random);
  base::Image image(kSide, kSide, 4);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      if (std::hypot(x - cx, y - cy) > radius) continue;
      const double light = 128.0 + look.luma * std::sin(pace * x + 0.5 * y) + look.noise * (unit(random) - 0.5);
      const double color = look.chroma * std::sin(1.7 * pace * (x - y));
      const double rgb[3] = {light + color, light, light - color};
      for (int c = 0; c < 3; ++c)
        image.at(x, y)[c] = static_cast<std::uint8_t>(std::lround(std::clamp(rgb[c], 0.0, 255.0)));
      image.at(x, y)[3] = 255;
    }
  }
  return image;
}

std::vector<base::Image> faces(const Look& look, unsigned count = 6) {
  std::vector<base::Image> all;
  for (unsigned seed = 1; seed <= count; ++seed) all.push_back(waves(seed, look));
  return all;
}

// Tries all 300 pairs, and finds the one of fewest bytes that reaches the PSNR.
std::optional<TuneChoice> byBruteForce(const std::vector<base::Image>& sample, double psnr_db) {
  std::optional<TuneChoice> best;
  for (const Subsampling subsampling : kAll) {
    for (int quality = 1; quality <= 100; ++quality) {
      const QualityMeasurement point = *measureQuality(sample, quality, subsampling, 1);
      if (point.psnr_db < psnr_db || (best && best->jpeg_bytes <= point.jpeg_bytes)) continue;
      best = TuneChoice{quality, subsampling, point.psnr_db, point.jpeg_bytes, sample.size()};
    }
  }
  return best;
}

// Adds up differences of the decoded pixels, without the code that is tested.
TEST(Tune, thePsnrIsThatOfAllModelPixelsTogether) {
  const auto sample = faces({}, 2);
  double squares = 0.0;
  double samples = 0.0;
  std::uint64_t bytes = 0;
  for (const base::Image& face : sample) {
    const auto jpeg = base::encodeJpeg(repository::fillBackground(face, coverageMask(face)), 40, Subsampling::k420);
    const auto back = base::decodeJpeg(*jpeg);
    bytes += jpeg->size();
    for (int y = 0; y < face.height; ++y)
      for (int x = 0; x < face.width; ++x) {
        if (face.at(x, y)[3] == 0) continue;
        for (int c = 0; c < 3; ++c) squares += std::pow(double{1} * back->at(x, y)[c] - face.at(x, y)[c], 2);
        samples += 3;
      }
  }
  const auto measured = measureQuality(sample, 40, Subsampling::k420, 2);
  ASSERT_TRUE(measured);
  EXPECT_EQ(measured->jpeg_bytes, bytes);
  EXPECT_NEAR(measured->psnr_db, 10.0 * std::log10(255.0 * 255.0 * samples / squares), 1e-9);
}

TEST(Tune, itFindsWhatBruteForceFinds) {
  for (const Look& look : {Look{}, Look{40.0, 0.0, 2.0}, Look{5.0, 60.0, 1.0}, Look{30.0, 30.0, 60.0}}) {
    const auto sample = faces(look);
    for (const double db : {24.0, 30.0, 34.5, 38.0}) {
      const auto expected = byBruteForce(sample, db);
      const auto found = tuneQuality(sample, db, 2);
      ASSERT_EQ(static_cast<bool>(found), expected.has_value()) << db;
      if (!expected) continue;
      EXPECT_GE(found->psnr_db, db);
      EXPECT_EQ(found->quality, expected->quality) << db;
      EXPECT_EQ(found->subsampling, expected->subsampling) << db;
      EXPECT_EQ(found->jpeg_bytes, expected->jpeg_bytes) << db;
    }
  }
}

// Grey faces have no chroma to lose; fine waves of red against blue need all of it.
TEST(Tune, chromaIsKeptWhereItIsNeeded) {
  EXPECT_EQ(tuneQuality(faces({40.0, 0.0, 2.0}), 36.0, 1)->subsampling, Subsampling::k420);
  EXPECT_EQ(tuneQuality(faces({5.0, 60.0, 1.0}), 36.0, 1)->subsampling, Subsampling::k444);
}

TEST(Tune, theChoiceDoesNotDependOnTheThreads) {
  const auto sample = faces({}, 9);
  const auto one = tuneQuality(sample, 35.0, 1);
  ASSERT_TRUE(one);
  for (const unsigned threads : {2U, 5U, 0U}) EXPECT_EQ(*tuneQuality(sample, 35.0, threads), *one);
}

TEST(Tune, refusesAnUnreachableAccuracyAndNamesTheBest) {
  const auto found = tuneQuality(faces({30.0, 30.0, 60.0}), 70.0, 0);
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, base::ErrorCode::kInvalidInput);
  EXPECT_NE(found.error().message.find("quality 100"), std::string::npos) << found.error().message;
  EXPECT_NE(found.error().message.find("not 70"), std::string::npos) << found.error().message;
}

TEST(Tune, theLowestQualityMayDo) {
  EXPECT_EQ(tuneQuality(faces({}), 1.0, 0)->quality, 1);
}

TEST(Tune, largeFacesMakeASmallerSample) {
  EXPECT_EQ(tuneFacesOf(16), 64U);
  EXPECT_EQ(tuneFacesOf(1024), 64U);
  EXPECT_EQ(tuneFacesOf(2048), 16U);
  EXPECT_EQ(tuneFacesOf(4096), 8U);
}

}  // namespace
}  // namespace server
