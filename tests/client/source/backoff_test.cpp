#include "client/source/backoff.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

namespace client {
namespace {

TEST(Backoff, pausesDoubleUpToALargestOne) {
  Backoff backoff(1);
  double middle = Backoff::kMinPause;
  for (int i = 0; i < 20; ++i) {
    const double pause = backoff.nextPause();
    EXPECT_GE(pause, 0.5 * middle);
    EXPECT_LE(pause, 1.5 * middle);
    middle = std::min(2.0 * middle, Backoff::kMaxPause);
  }
  EXPECT_EQ(middle, Backoff::kMaxPause);
}

TEST(Backoff, anAnswerMakesThemShortAgain) {
  Backoff backoff(1);
  for (int i = 0; i < 20; ++i) backoff.nextPause();
  backoff.reset();
  EXPECT_LE(backoff.nextPause(), 1.5 * Backoff::kMinPause);
  backoff.slowDown();
  EXPECT_GE(backoff.nextPause(), 0.5 * Backoff::kMaxPause);
}

// A thousand viewers whose server goes away come back over the whole of the range, some hundred in each tenth of it.
TEST(Backoff, manyViewersComeBackSpreadOverTime) {
  std::vector<int> tenths(10);
  for (std::uint32_t seed = 1; seed <= 1000; ++seed) {
    Backoff backoff(seed * 2'654'435'761U);
    const double place = (backoff.nextPause() / Backoff::kMinPause - 0.5) * 10.0;
    ++tenths[std::min<std::size_t>(static_cast<std::size_t>(place), 9)];
  }
  EXPECT_GT(*std::min_element(tenths.begin(), tenths.end()), 50);
  EXPECT_LT(*std::max_element(tenths.begin(), tenths.end()), 200);
}

TEST(Backoff, noTwoHaveTheSameSeed) {
  std::set<std::uint32_t> seeds;
  for (int i = 0; i < 100; ++i) seeds.insert(Backoff::randomSeed());
  EXPECT_GT(seeds.size(), 95U);
}

}  // namespace
}  // namespace client
