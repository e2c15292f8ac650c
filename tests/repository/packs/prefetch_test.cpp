#include "repository/packs/prefetch.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

namespace repository {
namespace {

std::uint64_t one(std::size_t) {
  return 1;
}

TEST(Prefetch, resultsComeInOrderWhicheverIsReadyFirst) {
  std::vector<std::size_t> taken;
  prefetchInOrder(
      20, {4, 100}, one,
      [](std::size_t i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(i % 4 == 0 ? 8 : 0));
        return 10 * i;
      },
      [&](std::size_t i, std::size_t made) {
        EXPECT_EQ(made, 10 * i);
        taken.push_back(i);
        return true;
      });
  ASSERT_EQ(taken.size(), 20U);
  for (std::size_t i = 0; i < taken.size(); ++i) EXPECT_EQ(taken[i], i);
}

// The largest number of items that were begun and not accepted yet.
std::size_t maxAhead(const PrefetchLimits& limits, const std::function<std::uint64_t(std::size_t)>& bytes_of) {
  std::atomic<std::size_t> begun{0};
  std::size_t most = 0;
  prefetchInOrder(
      30, limits, bytes_of, [&](std::size_t i) { return ++begun, i; },
      [&](std::size_t i, std::size_t) {
        most = std::max(most, begun.load() - i);
        return true;
      });
  return most;
}

TEST(Prefetch, noMoreItemsThanTheLimitsAllowAreAhead) {
  EXPECT_LE(maxAhead({4, 100}, one), 4U);
  EXPECT_LE(maxAhead({8, 3}, one), 3U) << "of three bytes";
  EXPECT_EQ(maxAhead({0, 0}, one), 1U) << "one always goes";
  EXPECT_EQ(maxAhead({4, 100}, [](std::size_t) { return std::uint64_t{1000}; }), 1U);
}

TEST(Prefetch, acceptMayStop) {
  std::atomic<std::size_t> begun{0};
  std::size_t taken = 0;
  prefetchInOrder(
      1000, {4, 100}, one, [&](std::size_t i) { return ++begun, i; },
      [&](std::size_t, std::size_t) { return ++taken < 5; });
  EXPECT_EQ(taken, 5U);
  EXPECT_LE(begun, 9U);
  prefetchInOrder(
      0, {4, 100}, one, [](std::size_t i) { return i; }, [](std::size_t, std::size_t) { return ADD_FAILURE(), true; });
}

}  // namespace
}  // namespace repository
