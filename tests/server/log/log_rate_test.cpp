#include "server/log/log_rate.h"

#include <gtest/gtest.h>

namespace server {
namespace {

using std::chrono::milliseconds;
const LogRate::Clock::time_point kStart{std::chrono::seconds(100)};

TEST(LogRate, soManyLinesOfAKindASecond) {
  LogRate rate(3);
  int admitted = 0;
  for (int i = 0; i < 10; ++i) admitted += rate.admit("connect", kStart) ? 1 : 0;
  EXPECT_EQ(admitted, 3);
  EXPECT_TRUE(rate.admit("disconnect", kStart)) << "each kind has its own";
  EXPECT_FALSE(rate.admit("connect", kStart + milliseconds(999)));
  EXPECT_TRUE(rate.admit("connect", kStart + milliseconds(1000)));
}

TEST(LogRate, theRestIsToldOnceWhenTheSecondIsOver) {
  LogRate rate(1);
  EXPECT_FALSE(rate.nextSummary());
  for (int i = 0; i < 5; ++i) rate.admit("connect", kStart);
  EXPECT_EQ(rate.nextSummary(), kStart + milliseconds(1000));
  EXPECT_TRUE(rate.takeSummaries(kStart + milliseconds(999)).empty());
  const auto summaries = rate.takeSummaries(kStart + milliseconds(1000));
  ASSERT_EQ(summaries.size(), 1U);
  EXPECT_EQ(summaries[0].kind, "connect");
  EXPECT_EQ(summaries[0].left_out, 4U);
  EXPECT_TRUE(rate.takeSummaries(kStart + milliseconds(5000)).empty());
  EXPECT_FALSE(rate.nextSummary());
}

TEST(LogRate, manyKindsShareOneWindow) {
  LogRate rate(1);
  int admitted = 0;
  for (int i = 0; i < 10'000; ++i) admitted += rate.admit("kind" + std::to_string(i), kStart) ? 1 : 0;
  EXPECT_LE(admitted, 65);
  EXPECT_GE(admitted, 64);
}

TEST(LogRate, zeroIsNoLimit) {
  LogRate rate(0);
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(rate.admit("connect", kStart));
}

}  // namespace
}  // namespace server
