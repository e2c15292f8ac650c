#include "compare/accuracy.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/picture_error.h"

namespace {

// A picture whose left half is model with a smooth pattern, and whose right half is background.
base::Image halfCovered(int shift) {
  base::Image image(64, 48, 4);
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 32; ++x) {
      auto* p = image.at(x, y);
      for (int c = 0; c < 3; ++c) p[c] = static_cast<std::uint8_t>(100 + 60 * std::sin(0.3 * x + 0.2 * y + c) + shift);
      p[3] = 255;
    }
  return image;
}

TEST(Accuracy, equalPictureIsPerfect) {
  auto a = compare::measureAccuracy(halfCovered(0), halfCovered(0));
  ASSERT_TRUE(a);
  EXPECT_EQ(a->psnr_db, 99.0);
  EXPECT_NEAR(a->ssim, 1.0, 1e-6);
  EXPECT_EQ(a->foreground, 32U * 48U);
}

TEST(Accuracy, constantOffsetHasItsClosedFormPsnr) {
  auto a = compare::measureAccuracy(halfCovered(0), halfCovered(10));
  ASSERT_TRUE(a);
  EXPECT_NEAR(a->psnr_db, 20.0 * std::log10(255.0 / 10.0), 1e-6);
  EXPECT_NEAR(a->mean_abs, 10.0, 1e-6);
}

// Two ways to the same figure: OpenCV's here, and the one of `build --methods auto`, which links no OpenCV.
TEST(Accuracy, psnrEqualsThatOfTheTrialOfMethods) {
  base::Image truth = halfCovered(0), picture = halfCovered(9);
  for (int y = 0; y < 48; ++y) {
    truth.at(30, y)[3] = static_cast<std::uint8_t>(5 * y);
    picture.at(40, y)[3] = static_cast<std::uint8_t>(200 - 2 * y);
    picture.at(3, y)[3] = 0;
  }
  const auto a = compare::measureAccuracy(truth, picture);
  ASSERT_TRUE(a);
  EXPECT_NEAR(a->psnr_db, base::foregroundError(truth, picture).psnr(), 1e-4);
}

TEST(Accuracy, backgroundFlattersNobody) {
  // Twice the background around the same error does not change the figure.
  base::Image truth(128, 48, 4);
  base::Image picture(128, 48, 4);
  const base::Image a = halfCovered(0);
  const base::Image b = halfCovered(10);
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 64; ++x) {
      std::copy_n(a.at(x, y), 4, truth.at(x, y));
      std::copy_n(b.at(x, y), 4, picture.at(x, y));
    }
  auto small = compare::measureAccuracy(a, b);
  auto large = compare::measureAccuracy(truth, picture);
  ASSERT_TRUE(small && large);
  EXPECT_NEAR(small->psnr_db, large->psnr_db, 1e-9);
}

TEST(Accuracy, holesAndExcessAreCounted) {
  base::Image picture = halfCovered(0);
  for (int y = 0; y < 48; ++y) {
    picture.at(0, y)[3] = 0;     // one column of 32 missing
    picture.at(40, y)[3] = 255;  // one too much
  }
  auto a = compare::measureAccuracy(halfCovered(0), picture);
  ASSERT_TRUE(a);
  EXPECT_NEAR(a->missing_share, 1.0 / 32.0, 1e-12);
  EXPECT_NEAR(a->excess_share, 1.0 / 32.0, 1e-12);
  EXPECT_LT(a->psnr_db, 40.0);
}

TEST(Accuracy, onlyForegroundCountsAndGreyLiesBeneath) {
  base::Image truth(3, 1, 4);
  base::Image picture(3, 1, 4);
  truth.pixels = {10, 20, 30, 255, 0, 0, 0, 0, 1, 2, 3, 0};
  picture.pixels = {13, 20, 30, 255, 9, 9, 9, 0, 118, 118, 120, 255};
  const auto a = compare::measureAccuracy(truth, picture);
  ASSERT_TRUE(a);
  EXPECT_EQ(a->foreground, 2U);  // the second pixel is background in both
  // The first pixel is off by 3; the third is grey against 118, 118, 120.
  EXPECT_NEAR(a->psnr_db, 10.0 * std::log10(255.0 * 255.0 * 6.0 / (9.0 + 4.0)), 1e-4);
  EXPECT_NEAR(a->mean_abs, (3.0 + 2.0) / 6.0, 1e-5);
}

TEST(Accuracy, pixelsCoveredByASixteenthAreForeground) {
  base::Image truth(2, 1, 4);
  truth.pixels = {0, 0, 0, 15, 200, 200, 200, 16};
  const auto a = compare::measureAccuracy(truth, base::Image(2, 1, 4));
  ASSERT_TRUE(a);
  EXPECT_EQ(a->foreground, 1U);
  EXPECT_NEAR(a->mean_abs, 16.0 / 255.0 * (200.0 - 118.0), 1e-4);  // a sixteenth of 200 over grey, against grey
  EXPECT_EQ(a->missing_share, 0.0) << "which are of pixels covered by half";
}

TEST(Accuracy, silhouetteDistanceIsHowFarAnEdgeMoved) {
  // The model is a bar from x = 8 to `end`, over all rows.
  const auto bar = [](int end) {
    base::Image image(64, 48, 4);
    for (int y = 0; y < 48; ++y)
      for (int x = 8; x < end; ++x) image.at(x, y)[3] = 255;
    return image;
  };
  const auto same = compare::measureAccuracy(bar(40), bar(40));
  const auto moved = compare::measureAccuracy(bar(40), bar(44));
  ASSERT_TRUE(same && moved);
  EXPECT_EQ(same->silhouette_px, 0.0);
  EXPECT_NEAR(moved->silhouette_px, 2.0, 1e-6);  // one of two edges by 4 pixels
  EXPECT_NEAR(moved->silhouette_p95_px, 4.0, 1e-6);
}

TEST(Accuracy, differenceIsFourTimesTheErrorAndSaturates) {
  base::Image truth(3, 1, 4);
  base::Image picture(3, 1, 4);
  truth.pixels = {10, 20, 30, 255, 0, 0, 0, 255, 7, 7, 7, 255};
  picture.pixels = {13, 20, 25, 255, 255, 64, 63, 255, 7, 7, 7, 255};
  EXPECT_EQ(compare::differencePicture(truth, picture).pixels,
            (std::vector<std::uint8_t>{12, 0, 20, 255, 255, 252, 0, 0, 0}));
}

TEST(Accuracy, ssimFallsWhenStructureIsLostAndPsnrIsTheSame) {
  const base::Image truth = halfCovered(0);
  base::Image noisy = truth;
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 32; ++x)
      for (int c = 0; c < 3; ++c)
        noisy.at(x, y)[c] = static_cast<std::uint8_t>(noisy.at(x, y)[c] + ((x + y) % 2 == 0 ? 10 : -10));
  auto shifted = compare::measureAccuracy(truth, halfCovered(10));
  auto scrambled = compare::measureAccuracy(truth, noisy);
  ASSERT_TRUE(shifted && scrambled);
  EXPECT_NEAR(shifted->psnr_db, scrambled->psnr_db, 1e-6);
  EXPECT_LT(scrambled->ssim, shifted->ssim - 0.05);
}

TEST(Accuracy, flickerIsWhatADisplayChangesBeyondTheTruth) {
  using compare::measureFlicker;
  const base::Image dark = halfCovered(0), bright = halfCovered(10);
  EXPECT_EQ(measureFlicker({dark, dark}, {bright, bright}).mean, 0.0);
  EXPECT_NEAR(measureFlicker({dark, dark}, {dark, bright}).mean, 10.0, 1e-4);
  // A picture that stays while the truth changes is wrong, but does not flicker; nor does one that is always wrong.
  EXPECT_EQ(measureFlicker({dark, dark}, {bright, dark}).mean, 0.0);
  EXPECT_EQ(measureFlicker({dark, bright}, {dark, bright}).mean, 0.0);
  // A quarter of the foreground sparks by 40 levels.
  base::Image sparks = dark;
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 32; ++x)
      for (int c = 0; c < 3; ++c) sparks.at(x, y)[c] = static_cast<std::uint8_t>(sparks.at(x, y)[c] + 40);
  EXPECT_NEAR(measureFlicker({dark, sparks}, {dark, dark}).mean, 10.0, 1e-4);
  EXPECT_EQ(measureFlicker({dark, sparks}, {dark, dark}).share, 0.25);
  EXPECT_EQ(measureFlicker({dark, sparks}, {sparks, dark}).share, 0.0) << "the truth sparks as well";
}

TEST(Accuracy, differentSizesAndEmptyPicturesAreErrors) {
  EXPECT_FALSE(compare::measureAccuracy(base::Image(4, 4, 4), base::Image(4, 5, 4)));
  EXPECT_FALSE(compare::measureAccuracy(base::Image(4, 4, 4), base::Image(4, 4, 4)));
}

}  // namespace
