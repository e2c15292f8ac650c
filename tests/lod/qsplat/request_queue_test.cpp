#include "lod/qsplat/stream/request_queue.h"

#include <gtest/gtest.h>

#include <random>

namespace lod::qsplat {
namespace {

TEST(Availability, holdsTwoBitsABlockAndCountsThem) {
  constexpr std::uint64_t kBlocks = 1000;
  Availability availability(kBlocks);
  std::vector<BlockState> truth(kBlocks, BlockState::kAbsent);
  std::mt19937 random(3);
  for (int i = 0; i < 20'000; ++i) {
    const std::uint64_t number = random() % kBlocks;
    truth[number] = static_cast<BlockState>(random() % 4);
    availability.setState(number, truth[number]);
  }
  for (std::uint64_t b = 0; b < kBlocks; ++b) EXPECT_EQ(availability.stateOf(b), truth[b]) << b;
  for (int state = 0; state < 4; ++state)
    EXPECT_EQ(availability.count(static_cast<BlockState>(state)),
              static_cast<std::uint64_t>(std::count(truth.begin(), truth.end(), static_cast<BlockState>(state))));
}

TEST(Availability, findsTheNextAbsentBlockOrTheEnd) {
  Availability availability(200);
  for (std::uint64_t b = 0; b < 200; ++b)
    if (b != 3 && b != 64 && b != 131)
      availability.setState(b, b == 100   ? BlockState::kRequested
                               : b == 101 ? BlockState::kWanted
                                          : BlockState::kPresent);
  EXPECT_EQ(availability.nextAbsent(0), 3U);
  EXPECT_EQ(availability.nextAbsent(3), 3U);
  EXPECT_EQ(availability.nextAbsent(4), 64U);
  EXPECT_EQ(availability.nextAbsent(65), 131U);
  EXPECT_EQ(availability.nextAbsent(132), 200U);
  EXPECT_EQ(availability.nextAbsent(200), 200U);
}

TEST(RequestQueue, givesTheMostUrgentBlockWithItsNeighbours) {
  Availability availability(100);
  availability.setState(14, BlockState::kPresent);
  RequestQueue queue(availability);
  //            12 13 (14 is here) 15 16 17    40          17 is outside of a lens
  for (const auto& [block, priority] : std::vector<std::pair<std::uint64_t, float>>{{12, 1e6F + 4900.0F},
                                                                                    {13, 1e6F + 5000.0F},
                                                                                    {14, 1e6F + 9000.0F},
                                                                                    {15, 1e6F + 4950.0F},
                                                                                    {16, 1e6F + 5200.0F},
                                                                                    {17, 100.0F},
                                                                                    {40, 1e6F + 5100.0F}})
    queue.add({block, priority});
  EXPECT_EQ(availability.count(BlockState::kWanted), 6U);

  EXPECT_EQ(queue.takeRun(10), (BlockRun{15, 2}));
  EXPECT_EQ(queue.takeRun(10), (BlockRun{40, 1}));
  EXPECT_EQ(queue.takeRun(1), (BlockRun{13, 1}));
  EXPECT_EQ(queue.takeRun(0), (BlockRun{0, 0}));
  EXPECT_EQ(queue.takeRun(10), (BlockRun{12, 1}));
  EXPECT_EQ(queue.takeRun(10), (BlockRun{17, 1}));
  EXPECT_EQ(queue.takeRun(10).count, 0U);
  EXPECT_TRUE(queue.empty());
  EXPECT_EQ(availability.count(BlockState::kRequested), 6U);
}

TEST(RequestQueue, forgetsWhatIsNotWantedAnyMoreAndKeepsWhatIsUnderWay) {
  Availability availability(100);
  RequestQueue queue(availability);
  for (std::uint64_t b = 20; b < 30; ++b) queue.add({b, static_cast<float>(b)});
  EXPECT_EQ(queue.takeRun(2), (BlockRun{28, 2}));
  queue.clear();
  EXPECT_EQ(availability.count(BlockState::kWanted), 0U);
  EXPECT_EQ(availability.count(BlockState::kRequested), 2U);
  queue.add({29, 1.0F});
  queue.add({5, 0.5F});
  EXPECT_EQ(queue.takeRun(10), (BlockRun{5, 1}));
  EXPECT_EQ(queue.takeRun(10).count, 0U);
}

}  // namespace
}  // namespace lod::qsplat
