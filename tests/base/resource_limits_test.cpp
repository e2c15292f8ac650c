// Zeros stand for what the machine has; given limits stay.
#include "base/resource_limits.h"

#include <gtest/gtest.h>

#include "base/memory.h"
#include "base/parallel.h"

namespace {

TEST(ResourceLimits, zerosBecomeAllCoresAndThreeFifthsOfTheMemory) {
  const base::ResourceLimits limits = base::ResourceLimits{}.resolved();
  EXPECT_EQ(limits.threads, base::coreCount());
  EXPECT_EQ(limits.memory_bytes, base::machineMemory() / 10 * 6);
  EXPECT_GT(limits.memory_bytes, std::uint64_t{100} << 20);
}

TEST(ResourceLimits, givenNumbersStay) {
  const base::ResourceLimits limits = base::ResourceLimits{3, 1'000}.resolved();
  EXPECT_EQ(limits.threads, 3U);
  EXPECT_EQ(limits.memory_bytes, 1'000U);
}

}  // namespace
