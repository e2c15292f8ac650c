// Tests which triangles of a two-sided mesh go, and that flat folds of a closed one stay.
#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "lod/ingest/two_sided.h"

namespace {

using Triangles = std::vector<std::array<std::uint64_t, 3>>;

std::vector<std::uint32_t> turnedOver(const Triangles& triangles) {
  std::vector<lod::ingest::Corner> corners;
  for (const auto& triangle : triangles)
    for (const std::uint64_t code : triangle) {
      corners.emplace_back();
      corners.back().code = code;
    }
  return lod::ingest::turnedOver(corners);
}

using Numbers = std::vector<std::uint32_t>;

TEST(TwoSided, theLaterWindingGoes) {
  EXPECT_EQ(turnedOver({{1, 2, 3}, {3, 2, 4}, {2, 1, 3}, {2, 3, 4}}), (Numbers{2, 3}));
  // Beside one-sided triangles, however the corners are turned, and where one is there three times.
  EXPECT_EQ(turnedOver({{1, 2, 3}, {1, 3, 2}, {2, 4, 3}, {3, 2, 1}, {2, 3, 1}}), (Numbers{1, 3}));
  EXPECT_EQ(turnedOver({{1, 2, 3}, {2, 3, 1}, {2, 3, 4}}), Numbers{});
}

TEST(TwoSided, foldsOfAClosedSurfaceStay) {
  // Two triangles of a fold, and the surface that goes on at two of its edges.
  const Triangles fold{{1, 2, 3}, {1, 3, 2}, {3, 2, 4}, {2, 3, 5}, {1, 3, 6}, {3, 1, 7}};
  EXPECT_EQ(turnedOver(fold), Numbers{});
  // A longer fold is kept as a whole, and a sheet that isn't connected with it is not.
  Triangles both{{1, 2, 8}, {2, 1, 8}, {11, 12, 13}, {13, 12, 11}};
  both.insert(both.end(), fold.begin(), fold.end());
  EXPECT_EQ(turnedOver(both), Numbers{3});
}

}  // namespace
