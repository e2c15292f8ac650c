#include "base/parallel.h"

#include <gtest/gtest.h>

#include <atomic>

namespace {

TEST(LargestFirst, ordersBySizeAndThenByIndex) {
  const std::vector<std::uint64_t> sizes{3, 7, 0, 7, std::uint64_t{1} << 40, 3};
  EXPECT_EQ(base::largestFirst(sizes), (std::vector<std::size_t>{4, 1, 3, 0, 5, 2}));
  EXPECT_TRUE(base::largestFirst({}).empty());
}

TEST(ParallelFor, runsEveryIndexOnce) {
  for (unsigned threads : {1U, 2U, 7U}) {
    std::vector<std::atomic<int>> done(1000);
    base::parallelFor(done.size(), threads, [&](std::size_t i) { ++done[i]; });
    for (const auto& d : done) EXPECT_EQ(d.load(), 1);
  }
}

// An item stays in its slot until it is consumed, and items are consumed in order.
TEST(ParallelInOrder, consumesEveryItemInOrderFromItsSlot) {
  constexpr std::size_t kCount = 500;
  for (unsigned threads : {1U, 2U, 7U})
    for (std::size_t slots : {std::size_t{1}, std::size_t{3}, std::size_t{2000}}) {
      std::vector<std::size_t> room(slots);
      std::vector<std::size_t> taken;
      std::atomic<std::size_t> made{0};
      const auto make = [&](std::size_t i, std::size_t slot) -> base::Result<void> {
        ++made;
        room[slot] = i * i;
        return {};
      };
      const auto take = [&](std::size_t i, std::size_t slot) -> base::Result<void> {
        EXPECT_EQ(room[slot], i * i);
        EXPECT_LE(made.load(), i + slots) << "more than there is room for";
        taken.push_back(i);
        return {};
      };
      ASSERT_TRUE(base::parallelInOrder(kCount, threads, slots, make, take));
      ASSERT_EQ(taken.size(), kCount);
      for (std::size_t i = 0; i < kCount; ++i) EXPECT_EQ(taken[i], i);
    }
}

TEST(ParallelInOrder, stopsAtTheFirstErrorOfEither) {
  for (unsigned threads : {1U, 3U})
    for (const bool while_made : {true, false}) {
      std::size_t taken = 0;
      const auto failAt = [](bool fails, std::size_t i) -> base::Result<void> {
        if (fails && i == 20) return base::Error{base::ErrorCode::kNoSpace, "the twentieth"};
        return {};
      };
      const auto made = [&](std::size_t i, std::size_t) { return failAt(while_made, i); };
      const auto take = [&](std::size_t i, std::size_t) {
        ++taken;
        return failAt(!while_made, i);
      };
      const auto done = base::parallelInOrder(1000, threads, 4, made, take);
      ASSERT_FALSE(done);
      EXPECT_EQ(done.error().message, "the twentieth");
      EXPECT_LE(taken, 21U);
    }
}

TEST(ThreadPool, drainWaitsForAllAndTheQueueStaysBounded) {
  base::ThreadPool pool(3, 4);
  std::atomic<int> done{0};
  for (int i = 0; i < 500; ++i) pool.submit([&] { ++done; });
  pool.drain();
  EXPECT_EQ(done.load(), 500);
}

}  // namespace
