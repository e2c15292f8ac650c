#include "repository/cache.h"

#include <gtest/gtest.h>

#include <string>

namespace repository {
namespace {

const auto kNothingPinned = [](const int&) { return false; };

TEST(LruCache, evictsTheLeastRecentlyUsedFirst) {
  LruCache<int, std::string> cache(30);
  for (int key = 1; key <= 4; ++key) cache.insert(key, std::to_string(key), 10);
  ASSERT_NE(cache.find(1), nullptr);  // now 2 is the oldest
  EXPECT_EQ(cache.evict(kNothingPinned), std::vector<int>{2});
  EXPECT_EQ(cache.bytes(), 30U);
  EXPECT_FALSE(cache.contains(2));
  EXPECT_EQ(*cache.find(1), "1");
}

TEST(LruCache, evictsOnlyUntilTheBudgetHolds) {
  LruCache<int, int> cache(100);
  cache.insert(1, 1, 60);
  cache.insert(2, 2, 40);
  EXPECT_TRUE(cache.evict(kNothingPinned).empty());
  cache.insert(3, 3, 1);
  EXPECT_EQ(cache.evict(kNothingPinned), std::vector<int>{1});
  EXPECT_EQ(cache.bytes(), 41U);
}

TEST(LruCache, pinnedValuesStayEvenOverTheBudget) {
  LruCache<int, int> cache(15);
  for (int key = 1; key <= 3; ++key) cache.insert(key, key, 10);
  EXPECT_EQ(cache.evict([](const int& key) { return key != 2; }), std::vector<int>{2});
  EXPECT_EQ(cache.size(), 2U);
  EXPECT_EQ(cache.bytes(), 20U);
}

TEST(LruCache, replacingAValueCountsItsBytesOnce) {
  LruCache<int, int> cache(100);
  cache.insert(1, 1, 70);
  cache.insert(1, 2, 20);
  EXPECT_EQ(cache.bytes(), 20U);
  EXPECT_EQ(cache.size(), 1U);
  EXPECT_EQ(*cache.find(1), 2);
}

TEST(LruCache, containsDoesNotCountAsUse) {
  LruCache<int, int> cache(10);
  cache.insert(1, 1, 10);
  cache.insert(2, 2, 10);
  EXPECT_TRUE(cache.contains(1));
  EXPECT_EQ(cache.evict(kNothingPinned), std::vector<int>{1});
}

TEST(LruCache, erasingAnAbsentKeyDoesNothing) {
  LruCache<int, int> cache(10);
  cache.insert(1, 1, 4);
  EXPECT_FALSE(cache.erase(7));
  EXPECT_TRUE(cache.erase(1));
  EXPECT_FALSE(cache.erase(1));
  EXPECT_EQ(cache.find(1), nullptr);
  EXPECT_EQ(cache.bytes(), 0U);
}

}  // namespace
}  // namespace repository
