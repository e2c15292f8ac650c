#include "client/source/duty_cycle.h"

#include <gtest/gtest.h>

namespace client {
namespace {

TEST(DutyCycle, restsForSoManyTimesTheLastWork) {
  DutyCycle cycle;
  EXPECT_TRUE(cycle.hasRested(0.0)) << "nothing was done yet";
  cycle.record(10.0, 10.5);
  EXPECT_FALSE(cycle.hasRested(10.5 + 0.49 * DutyCycle::kRest));
  EXPECT_TRUE(cycle.hasRested(10.5 + 0.51 * DutyCycle::kRest));
}

TEST(DutyCycle, restsLongerBeforeMoreWorkAndNoShorterBeforeLess) {
  DutyCycle cycle;
  cycle.record(10.0, 10.5, 1000.0);
  const double end = 10.5 + 0.5 * DutyCycle::kRest;
  EXPECT_FALSE(cycle.hasRested(end + 0.01, 4000.0));
  EXPECT_TRUE(cycle.hasRested(10.5 + 2.01 * DutyCycle::kRest, 4000.0));
  EXPECT_TRUE(cycle.hasRested(end + 0.01, 10.0));
  EXPECT_FALSE(cycle.hasRested(end - 0.01, 10.0));
}

}  // namespace
}  // namespace client
