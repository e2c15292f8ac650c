#include "client/render/sample_array.h"

#include <gtest/gtest.h>

namespace client {
namespace {

std::vector<int> steps(const LayerGrowth& growth) {
  std::vector<int> capacities;
  for (int now = 0, next = growth.after(0); next > now; now = next, next = growth.after(now))
    capacities.push_back(next);
  return capacities;
}

TEST(LayerGrowth, doublesWhileTheBudgetHoldsOldAndNewOnes) {
  EXPECT_EQ(steps({.first = 4, .affordable = 100, .at_once = 32, .most = 256}), (std::vector<int>{4, 8, 16, 32, 64}));
  EXPECT_EQ(steps({.first = 4, .affordable = 90, .at_once = 32, .most = 256}), (std::vector<int>{4, 8, 16, 32, 58}));
}

TEST(LayerGrowth, aBudgetForFewIsAllocatedWhole) {
  EXPECT_EQ(steps({.first = 4, .affordable = 32, .at_once = 32, .most = 256}), (std::vector<int>{32}));
  EXPECT_EQ(steps({.first = 4, .affordable = 0, .at_once = 32, .most = 256}), (std::vector<int>{}));
}

TEST(LayerGrowth, reachesTheLimitOfLayersWhereTheBudgetHoldsMore) {
  EXPECT_EQ(steps({.first = 4, .affordable = 560, .at_once = 128, .most = 256}),
            (std::vector<int>{4, 8, 16, 32, 64, 128, 256}));
  EXPECT_EQ(steps({.first = 4, .affordable = 100, .at_once = 128, .most = 64}), (std::vector<int>{64}));
}

}  // namespace
}  // namespace client
