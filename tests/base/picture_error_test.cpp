#include "base/picture_error.h"

#include <gtest/gtest.h>

#include <cmath>

namespace base {
namespace {

TEST(PictureError, onlyForegroundCountsAndGreyLiesBeneath) {
  Image truth(3, 1, 4);
  Image picture(3, 1, 4);
  truth.pixels = {10, 20, 30, 255, 0, 0, 0, 0, 1, 2, 3, 0};
  picture.pixels = {13, 20, 30, 255, 9, 9, 9, 0, 118, 118, 120, 255};
  const PictureError error = pictureError(truth, picture);
  EXPECT_EQ(error.samples, 6U);                 // the second pixel is background in both
  EXPECT_NEAR(error.squared, 9.0 + 4.0, 1e-3);  // the third: grey against 118, 118, 120
  EXPECT_NEAR(error.absolute, 3.0 + 2.0, 1e-3);
  EXPECT_NEAR(error.psnr(), 10.0 * std::log10(255.0 * 255.0 * 6.0 / 13.0), 1e-6);
  EXPECT_EQ(pictureError(truth, truth).psnr(), kEqualDb);
  EXPECT_EQ(PictureError().psnr(), kEqualDb);
}

TEST(PictureError, coverageCountsByHalves) {
  Image truth(2, 1, 4);
  Image picture(2, 1, 4);
  truth.pixels = {0, 0, 0, 127, 200, 200, 200, 128};
  EXPECT_EQ(pictureError(truth, picture).samples, 3U);
  // 128 / 255 of 200 over grey, against grey.
  EXPECT_NEAR(pictureError(truth, picture).absolute, 3.0 * 128.0 / 255.0 * (200.0 - 118.0), 1e-3);
}

TEST(PictureError, modelErrorComparesColoursWithoutBackground) {
  Image rgba(3, 1, 4);
  Image rgb(3, 1, 3);
  rgba.pixels = {10, 20, 30, 255, 1, 2, 3, 127, 50, 60, 70, 128};
  rgb.pixels = {11, 20, 28, 255, 255, 255, 50, 60, 73};
  const PictureError error = modelError(rgba, rgb);
  EXPECT_EQ(error.samples, 6U);
  EXPECT_EQ(error.squared, 1.0 + 4.0 + 9.0);
  EXPECT_EQ(error.absolute, 1.0 + 2.0 + 3.0);
}

TEST(PictureError, partialSumsAddUp) {
  PictureError all;
  all.add(2.0);
  PictureError more;
  more.add(-3.0);
  all.add(more);
  EXPECT_EQ(all.squared, 13.0);
  EXPECT_EQ(all.absolute, 5.0);
  EXPECT_EQ(all.samples, 2U);
}

}  // namespace
}  // namespace base
