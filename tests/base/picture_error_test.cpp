#include "base/picture_error.h"

#include <gtest/gtest.h>

#include <cmath>

namespace base {
namespace {

TEST(PictureError, modelErrorComparesColoursWithoutBackground) {
  Image rgba(3, 1, 4);
  Image rgb(3, 1, 3);
  rgba.pixels = {10, 20, 30, 255, 1, 2, 3, 126, 50, 60, 70, 127};
  rgb.pixels = {11, 20, 28, 255, 255, 255, 50, 60, 73};
  const PictureError error = modelError(rgba, rgb);
  EXPECT_EQ(error.samples, 6U);
  EXPECT_EQ(error.squared, 1.0 + 4.0 + 9.0);
  EXPECT_EQ(error.absolute, 1.0 + 2.0 + 3.0);
}

TEST(PictureError, foregroundErrorCountsHolesAndWhatStandsOver) {
  Image truth(4, 1, 4), picture(4, 1, 4);
  // Model in both, in the truth alone, in the picture alone, in neither.
  truth.pixels = {10, 20, 30, 255, 118, 119, 120, 255, 7, 7, 7, 0, 1, 2, 3, 15};
  picture.pixels = {13, 20, 30, 255, 9, 9, 9, 0, 118, 118, 114, 255, 200, 200, 200, 15};
  const PictureError error = foregroundError(truth, picture);
  EXPECT_EQ(error.samples, 9U);
  EXPECT_NEAR(error.squared, 9.0 + (0.0 + 1.0 + 4.0) + 16.0, 1e-9);
}

// A line that covers a quarter of its pixels counts whether the picture has it or not.
TEST(PictureError, foregroundErrorCountsThinParts) {
  Image truth(1, 1, 4), picture(1, 1, 4);
  truth.pixels = {218, 118, 118, 51};
  EXPECT_EQ(foregroundError(truth, truth).samples, 3U);
  EXPECT_NEAR(foregroundError(truth, picture).squared, 400.0, 1e-9);
}

TEST(PictureError, foregroundErrorWeighsColoursByCoverage) {
  Image truth(1, 1, 4), picture(1, 1, 4);
  truth.pixels = {218, 118, 118, 255};
  picture.pixels = {218, 118, 118, 204};  // four fifths covered: a fifth of 100 levels is lost
  EXPECT_NEAR(foregroundError(truth, picture).squared, 400.0, 1e-9);
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
  EXPECT_NEAR(all.psnr(), 10.0 * std::log10(255.0 * 255.0 * 2.0 / 13.0), 1e-9);
  EXPECT_EQ(PictureError().psnr(), kEqualDb);
}

}  // namespace
}  // namespace base
