#include "client/render/pyramid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace {

using client::premultipliedPyramid;

TEST(Pyramid, levelsHalveDownToOnePixelAndTheirBytesAreCounted) {
  const base::Image image(5, 3, 4);
  const auto levels = premultipliedPyramid(image);
  ASSERT_EQ(levels.size(), 3U);
  EXPECT_EQ(levels[1].width, 2);
  EXPECT_EQ(levels[1].height, 1);
  EXPECT_EQ(levels[2].width, 1);
  EXPECT_EQ(client::pyramidLevels(5, 3), 3);
  EXPECT_EQ(client::pyramidBytes(5, 3), 4U * (15 + 2 + 1));
}

// The picture has one covered red pixel and three uncovered green ones. The mean over covered pixels is red.
TEST(Pyramid, backgroundDoesNotBleedIntoCoarseLevels) {
  base::Image image(2, 2, 4);
  for (int i = 0; i < 4; ++i) image.pixels[static_cast<std::size_t>(4 * i + 1)] = 255;
  image.at(0, 0)[0] = 200, image.at(0, 0)[1] = 0, image.at(0, 0)[3] = 255;
  const auto levels = premultipliedPyramid(image);
  const std::uint8_t* top = levels[1].at(0, 0);
  EXPECT_EQ(top[3], 64);
  EXPECT_EQ(top[1], 0);
  EXPECT_NEAR(255.0 * top[0] / top[3], 200.0, 2.0);
}

TEST(Pyramid, theFirstLevelIsTheImageBottomUp) {
  base::Image image(1, 2, 4);
  image.at(0, 0)[0] = 10, image.at(0, 0)[3] = 255;
  image.at(0, 1)[0] = 20, image.at(0, 1)[3] = 255;
  const auto levels = premultipliedPyramid(image);
  EXPECT_EQ(levels[0].at(0, 0)[0], 20);
  EXPECT_EQ(levels[0].at(0, 1)[0], 10);
}

TEST(Pyramid, texelsOfEvenLevelsAreMeansRoundedUp) {
  base::Image image(4, 2, 4);
  const auto set = [&](int x, int y, std::array<std::uint8_t, 3> rgb) {
    std::copy(rgb.begin(), rgb.end(), image.at(x, y));
    image.at(x, y)[3] = 255;
  };
  set(0, 0, {255, 0, 1}), set(1, 0, {255, 1, 0}), set(0, 1, {255, 0, 0}), set(1, 1, {254, 0, 1});
  set(2, 0, {7, 255, 9}), set(3, 0, {8, 0, 9}), set(2, 1, {9, 255, 8}), set(3, 1, {10, 0, 8});
  const base::Image half = premultipliedPyramid(image).at(1);
  const auto texel = [&](int x) { return std::vector<int>(half.at(x, 0), half.at(x, 0) + 4); };
  EXPECT_EQ(texel(0), (std::vector<int>{255, 0, 1, 255})) << "254.75, 0.25, 0.5";
  EXPECT_EQ(texel(1), (std::vector<int>{9, 128, 9, 255})) << "8.5, 127.5, 8.5";
}

TEST(Pyramid, anOddRowIsNotLost) {
  base::Image image(1, 3, 4);
  for (int y = 0; y < 3; ++y) image.at(0, y)[3] = 255;
  image.at(0, 0)[0] = 90;  // the last row in GL's order
  const auto levels = premultipliedPyramid(image);
  EXPECT_EQ(levels[1].at(0, 0)[0], 30);
}

}  // namespace
