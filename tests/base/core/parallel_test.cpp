#include "base/parallel.h"

#include <gtest/gtest.h>

#include <atomic>

namespace {

TEST(ParallelFor, doesEveryPieceOnce) {
  for (unsigned threads : {1U, 2U, 7U}) {
    std::vector<std::atomic<int>> done(1000);
    base::parallelFor(done.size(), threads, [&](std::size_t i) { ++done[i]; });
    for (const auto& d : done) EXPECT_EQ(d.load(), 1);
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
