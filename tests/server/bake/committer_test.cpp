#include "server/bake/committer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <thread>

#include "tests/server/bake/memory_store.h"

namespace server {
namespace {

using repository::FaceKey;
using test::MemoryStore;

FaceKey keyOf(std::uint64_t sequence) {
  return {static_cast<std::uint32_t>(sequence), 0, 0, 0};
}

TEST(Committer, facesInAnyOrderAreCommittedInTheirOwn) {
  MemoryStore store;
  Committer committer(store, 10, 100);
  std::vector<std::uint64_t> order(45);
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937(3));
  for (const std::uint64_t sequence : order) committer.deliver(sequence, keyOf(sequence), {{0, {1}}});
  ASSERT_TRUE(committer.finish());

  std::uint32_t next = 0;
  for (const auto& batch : store.batches) {
    EXPECT_LE(batch.size(), 10U);
    for (const FaceKey& key : batch) EXPECT_EQ(key, keyOf(next++));
  }
  EXPECT_EQ(next, 45U);
  EXPECT_EQ(store.batches.size(), 5U);
}

TEST(Committer, tilesOfAFaceAreInOneBatchHoweverMany) {
  MemoryStore store;
  Committer committer(store, 2, 10);
  for (const std::uint64_t sequence : {2U, 0U, 1U})
    committer.deliver(sequence, keyOf(sequence), {{0, {1}}, {2, {2}}, {9, {3}}});
  ASSERT_TRUE(committer.finish());
  ASSERT_EQ(store.batches.size(), 2U);
  EXPECT_EQ(store.batches[0].size(), 6U);
  EXPECT_EQ(store.batches[1].size(), 3U);
  EXPECT_EQ(store.values.at(FaceKey{1, 0, 0, 0, 9}), base::Bytes{3});
}

TEST(Committer, aBatchWaitsForTheFaceThatIsLate) {
  MemoryStore store;
  Committer committer(store, 2, 10);
  for (const std::uint64_t sequence : {1U, 2U, 3U}) committer.deliver(sequence, keyOf(sequence), {{0, {1}}});
  committer.fail({base::ErrorCode::kIo, "the rest never came"});
  EXPECT_FALSE(committer.finish());
  EXPECT_TRUE(store.batches.empty());
}

TEST(Committer, roomIsGivenOnlyAsFacesReachTheStore) {
  MemoryStore store;
  Committer committer(store, 2, 4);
  std::vector<std::thread> late;
  for (std::uint64_t sequence = 0; sequence < 200; ++sequence) {
    ASSERT_TRUE(committer.waitForRoom(sequence));
    late.emplace_back([&committer, sequence] { committer.deliver(sequence, keyOf(sequence), {{0, {1}}}); });
  }
  for (std::thread& thread : late) thread.join();
  ASSERT_TRUE(committer.finish());
  EXPECT_EQ(store.values.size(), 200U);
}

TEST(Committer, aFullStoreStopsTheWorkAndIsTold) {
  MemoryStore store;
  store.fail_at_batch = 3;
  Committer committer(store, 5, 20);
  std::uint64_t sequence = 0;
  while (committer.waitForRoom(sequence)) {
    committer.deliver(sequence, keyOf(sequence), {{0, {1}}});
    ++sequence;
    ASSERT_LT(sequence, 100U) << "the failure was never told";
  }
  const auto finished = committer.finish();
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().code, base::ErrorCode::kNoSpace);
  EXPECT_EQ(store.values.size(), 15U);
}

TEST(Committer, theFirstErrorStays) {
  MemoryStore store;
  Committer committer(store, 5, 20);
  committer.fail({base::ErrorCode::kIo, "first"});
  committer.fail({base::ErrorCode::kIo, "second"});
  EXPECT_FALSE(committer.waitForRoom(0));
  EXPECT_EQ(committer.finish().error().message, "first");
}

TEST(Committer, withoutFinishNothingIsLeftRunning) {
  MemoryStore store;
  {
    Committer committer(store, 5, 20);
    committer.deliver(0, keyOf(0), {{0, {1}}});
  }
  EXPECT_TRUE(store.batches.empty());
}

}  // namespace
}  // namespace server
