#include <gtest/gtest.h>

#include <algorithm>

#include "base/png/png.h"

namespace base {
namespace {

Image drawnImage(int width, int height, int channels) {
  Image image(width, height, channels);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = static_cast<std::uint8_t>(i * i / 7 + i / 31);
  return image;
}

Image rowsOf(const Image& image, int first, int count) {
  Image rows(image.width, count, image.channels);
  std::copy_n(image.at(0, first), rows.pixels.size(), rows.pixels.begin());
  return rows;
}

TEST(PngRows, theyMakeThePictureWhateverTheirNumber) {
  for (const int channels : {3, 4}) {
    const Image image = drawnImage(117, 61, channels);
    for (const int rows : {1, 7, 60, 61}) {
      Bytes bytes;
      auto png = beginPng(image.width, image.height, channels, bytes);
      ASSERT_TRUE(png);
      for (int y = 0; y < image.height; y += rows)
        ASSERT_TRUE((*png)->add(rowsOf(image, y, std::min(rows, image.height - y))));
      const auto read = decodePng(bytes);
      ASSERT_TRUE(read) << read.error().message;
      EXPECT_EQ(read->channels, channels);
      EXPECT_TRUE(read->pixels == image.pixels) << channels << " channels, " << rows << " rows at a time";
    }
  }
}

TEST(PngRows, aPictureThatWasNotFinishedIsNone) {
  const Image image = drawnImage(64, 64, 3);
  Bytes bytes;
  {
    auto png = beginPng(64, 64, 3, bytes);
    ASSERT_TRUE(png);
    ASSERT_TRUE((*png)->add(rowsOf(image, 0, 63)));
  }
  EXPECT_FALSE(decodePng(bytes));
}

TEST(PngRows, sidesThatNoPngHasAreAnError) {
  Bytes bytes;
  EXPECT_FALSE(beginPng(2'000'000, 1, 3, bytes));
}

}  // namespace
}  // namespace base
