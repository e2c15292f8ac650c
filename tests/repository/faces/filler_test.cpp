#include "repository/faces/filler.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

namespace repository {
namespace {

void paint(base::Image& image, int x, int y, std::uint8_t r, std::uint8_t g, std::uint8_t b, std::uint8_t a) {
  std::uint8_t* pixel = image.at(x, y);
  pixel[0] = r, pixel[1] = g, pixel[2] = b, pixel[3] = a;
}

base::Image maskWith(int width, int height, const std::vector<std::pair<int, int>>& model) {
  base::Image mask(width, height, 1);
  for (const auto& [x, y] : model) *mask.at(x, y) = 255;
  return mask;
}

// There is model at both ends: each hidden pixel between takes the mean of the smallest aligned square that holds
// model.
TEST(Filler, isTheMeanOfTheSmallestSquareThatHoldsModel) {
  base::Image image(32, 8, 4);
  paint(image, 0, 0, 10, 0, 0, 255);
  paint(image, 1, 0, 20, 0, 0, 255);
  paint(image, 31, 7, 30, 0, 0, 255);
  paint(image, 12, 4, 250, 250, 250, 100);  // hidden by the mask
  const base::Image filled = fillBackground(image, maskWith(32, 8, {{0, 0}, {1, 0}, {31, 7}}));
  EXPECT_EQ(filled.at(0, 0)[0], 10);
  EXPECT_EQ(filled.at(1, 0)[0], 20);
  EXPECT_EQ(filled.at(0, 1)[0], 15);
  EXPECT_EQ(filled.at(5, 5)[0], 15);
  EXPECT_EQ(filled.at(12, 4)[0], 15);
  EXPECT_EQ(filled.at(18, 4)[0], 30);
  EXPECT_EQ(filled.at(28, 4)[0], 30);
  EXPECT_EQ(filled.at(31, 7)[0], 30);
}

}  // namespace
}  // namespace repository
