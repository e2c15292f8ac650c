// Reads a repository of several shards as one store.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <thread>

#include "repository/repository.h"
#include "repository/sampling/parameters.h"
#include "tests/repository/sample_values.h"
#include "tests/repository/writer_process.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

const std::string kMeta =
    "{\n\"grid\": {\"first\": [0, 0, 0], \"spacing\": 1, \"count\": [3, 5, 2], \"face_size\": 64},\n\"quality\": 85\n}";

class ShardedTest : public testing::Test {
 protected:
  ShardedTest() {
    grid_.count = {3, 5, 2};
    grid_.face_size = 64;
  }
  std::string images() const { return directory_ / "images"; }
  std::string shardPath(std::uint32_t index) const { return storeDirectory(images(), 3, index); }

  // Returns the keys of a shard, each with a value made from the key's place in Morton order.
  std::vector<std::pair<FaceKey, base::Bytes>> valuesOf(const Shard& shard) const {
    std::vector<std::pair<FaceKey, base::Bytes>> values;
    const PointRange range = pointsOf(shard, grid_);
    for (std::uint64_t rank = range.first; rank < range.end; ++rank) {
      const glm::uvec3 p = pointAtMortonRank(grid_, rank);
      for (std::uint32_t d = 0; d < 6; ++d)
        values.emplace_back(FaceKey{p.x, p.y, p.z, d}, test::valueOf(static_cast<std::uint32_t>(6 * rank + d)));
    }
    return values;
  }
  void makeShard(std::uint32_t index, const std::string& meta = kMeta) const {
    auto store = openLmdbStore(shardPath(index), StoreMode::kWrite);
    ASSERT_TRUE(store) << store.error().message;
    ASSERT_TRUE((*store)->writeMeta(meta));
    ASSERT_TRUE((*store)->putBatch(valuesOf({index, 3})));
  }
  void expectRefused(const std::vector<std::string>& pieces) const {
    const auto refused = openRepository(images());
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, base::ErrorCode::kInvalidInput);
    for (const std::string& piece : pieces)
      EXPECT_NE(refused.error().message.find(piece), std::string::npos) << refused.error().message;
  }

  support::TemporaryDirectory directory_;
  Grid grid_;
};

TEST_F(ShardedTest, allShardsReadAsOneStore) {
  for (std::uint32_t i = 0; i < 3; ++i) makeShard(i);
  auto store = openRepository(images());
  ASSERT_TRUE(store) << store.error().message;
  const auto all = valuesOf({0, 1});
  for (const auto& [key, value] : all) {
    EXPECT_TRUE(*(*store)->contains(key));
    EXPECT_EQ(**(*store)->get(key), value);
  }
  EXPECT_EQ(*(*store)->size(), all.size());
  EXPECT_EQ(*(*store)->readMeta(), kMeta);
  EXPECT_EQ(*(*store)->get(FaceKey{7, 7, 7, 0}), std::nullopt);

  std::vector<std::pair<FaceKey, base::Bytes>> walked;
  ASSERT_TRUE((*store)->forEach([&](const FaceKey& key, base::ByteView value) {
    walked.emplace_back(key, base::Bytes(value.begin(), value.end()));
    return true;
  }));
  EXPECT_EQ(walked, all);
  std::vector<FaceKey> keys;
  ASSERT_TRUE((*store)->forEachKey([&](const FaceKey& key) {
    keys.push_back(key);
    return keys.size() < 100;
  }));
  ASSERT_EQ(keys.size(), 100U) << "it stops when told, also in a later shard";
  for (std::size_t i = 0; i < keys.size(); ++i) EXPECT_EQ(keys[i], all[i].first);
  EXPECT_FALSE((*store)->putBatch({all.front()}));
  EXPECT_FALSE((*store)->erase({all.front().first}));
}

TEST_F(ShardedTest, aShardIsReadAsSoonAsItAppears) {
  makeShard(1);
  auto store = openRepository(images());
  ASSERT_TRUE(store) << store.error().message;
  const auto first = valuesOf({0, 3}).front();
  EXPECT_EQ(*(*store)->get(first.first), std::nullopt);
  EXPECT_FALSE(*(*store)->contains(first.first));
  makeShard(0);
  EXPECT_EQ(**(*store)->get(first.first), first.second);
  EXPECT_EQ(*(*store)->size(), 120U);
}

TEST_F(ShardedTest, manyThreadsReadWhileShardsAppear) {
  makeShard(1);
  auto store = openRepository(images());
  ASSERT_TRUE(store) << store.error().message;
  const auto all = valuesOf({0, 1});
  std::atomic<int> wrong{0};
  std::atomic<bool> over{false};
  std::vector<std::thread> readers;
  for (int reader = 0; reader < 4; ++reader)
    readers.emplace_back([&] {
      while (!over) {
        for (const auto& [key, value] : all) {
          const auto read = (*store)->get(key);
          if (!read || (*read && **read != value)) ++wrong;
        }
      }
    });
  makeShard(0);
  makeShard(2);
  over = true;
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(*(*store)->size(), all.size());
}

TEST_F(ShardedTest, aShardWithoutParametersCountsAsAbsent) {
  makeShard(1);
  { ASSERT_TRUE(openLmdbStore(shardPath(0), StoreMode::kWrite)); }
  auto store = openRepository(images());
  ASSERT_TRUE(store) << store.error().message;
  const auto first = valuesOf({0, 3}).front();
  EXPECT_EQ(*(*store)->get(first.first), std::nullopt);
  makeShard(0);
  EXPECT_EQ(**(*store)->get(first.first), first.second);
}

TEST_F(ShardedTest, keysOfAnotherShardAreSkipped) {
  for (std::uint32_t i = 0; i < 3; ++i) makeShard(i);
  {
    auto store = openLmdbStore(shardPath(2), StoreMode::kWrite);
    ASSERT_TRUE((*store)->putBatch({{valuesOf({0, 3}).front().first, test::valueOf(5)}, {{9, 9, 9, 0}, {}}}));
  }
  auto store = openRepository(images());
  ASSERT_TRUE(store);
  std::vector<FaceKey> keys;
  ASSERT_TRUE((*store)->forEachKey([&](const FaceKey& key) {
    keys.push_back(key);
    return true;
  }));
  EXPECT_EQ(keys.size(), 180U);
  EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
  EXPECT_EQ(**(*store)->get(valuesOf({0, 3}).front().first), test::valueOf(0));
}

TEST_F(ShardedTest, opensAnUndividedRepository) {
  {
    auto store = openLmdbStore(images(), StoreMode::kWrite);
    ASSERT_TRUE((*store)->writeMeta(kMeta));
    ASSERT_TRUE((*store)->putBatch(valuesOf({0, 1})));
  }
  auto store = openRepository(images());
  ASSERT_TRUE(store);
  EXPECT_EQ(*(*store)->size(), 180U);
  EXPECT_TRUE(findMissing(images(), 0, grid_)->empty());
}

TEST_F(ShardedTest, shardsWithOtherParametersAreRefusedByName) {
  makeShard(0);
  std::string other = kMeta;
  makeShard(2, other.replace(other.find("85"), 2, "70"));
  expectRefused({"shard-0002-of-0003", "\"quality\": 85", "\"quality\": 70", "different parameters"});
}

TEST_F(ShardedTest, storesOfSeveralDivisionsAreRefused) {
  makeShard(0);
  std::filesystem::create_directories(images() + "/shard-0001-of-0007");
  expectRefused({"shards of 3 and of 7"});
  std::filesystem::remove(images() + "/shard-0001-of-0007");
  { ASSERT_TRUE(openLmdbStore(images(), StoreMode::kWrite)); }
  expectRefused({"undivided", "3 shards"});
  // A reader that knows the number of shards from scene.json can still read it.
  EXPECT_TRUE(openRepository(images(), 3));
}

TEST_F(ShardedTest, anEmptyDirectoryIsNotFound) {
  EXPECT_EQ(openRepository(images()).error().code, base::ErrorCode::kNotFound);
  std::filesystem::create_directories(shardPath(1));
  EXPECT_EQ(openRepository(images()).error().code, base::ErrorCode::kNotFound);
}

TEST_F(ShardedTest, findMissingReportsEachShard) {
  const auto nothing = findMissing(images(), 3, grid_);
  ASSERT_TRUE(nothing);
  ASSERT_EQ(nothing->size(), 3U);
  EXPECT_EQ((*nothing)[1].faces, 60U);

  makeShard(0);
  makeShard(2);
  {
    auto store = openLmdbStore(shardPath(2), StoreMode::kWrite);
    const auto values = valuesOf({2, 3});
    ASSERT_TRUE((*store)->erase({values[3].first, values[4].first, values[59].first}));
    ASSERT_TRUE((*store)->putBatch({{valuesOf({1, 3}).front().first, {}}}));  // a key of another shard fills no gap
  }
  const auto missing = findMissing(images(), 3, grid_);
  ASSERT_TRUE(missing);
  ASSERT_EQ(missing->size(), 2U);
  EXPECT_EQ((*missing)[0].shard, (Shard{1, 3}));
  EXPECT_EQ((*missing)[0].faces, 60U);
  EXPECT_EQ((*missing)[1].faces, 3U);
  const auto values = valuesOf({2, 3});
  EXPECT_EQ((*missing)[1].gaps,
            (std::vector<Gap>{{values[3].first, values[4].first, 2}, {values[59].first, values[59].first, 1}}));
  makeShard(1);
  makeShard(2);
  EXPECT_TRUE(findMissing(images(), 3, grid_)->empty());
}

TEST_F(ShardedTest, missingFacesAreThoseOfSelectedPoints) {
  SampleTree tree(grid_, 4);
  tree.split({{0, 0, 0}, 4});
  tree.leaveOut({0, 0, 0});
  const auto points = tree.points();
  const auto nothing = findMissing(images(), 0, grid_, &tree);
  ASSERT_TRUE(nothing);
  ASSERT_EQ(nothing->size(), 1U);
  EXPECT_EQ(nothing->front().faces, 6 * points.size());

  // All but one point is rendered; the store's own tree counts.
  auto store = std::move(*openLmdbStore(images(), StoreMode::kWrite));
  ASSERT_TRUE(store->writeMeta(withTree(kMeta + "\n", tree)));
  std::vector<std::pair<FaceKey, base::Bytes>> values;
  for (std::size_t i = 1; i < points.size(); ++i)
    for (std::uint32_t d = 0; d < 6; ++d)
      values.emplace_back(FaceKey{points[i].x, points[i].y, points[i].z, d}, base::Bytes{1});
  ASSERT_TRUE(store->putBatch(values));
  store.reset();
  const auto missing = findMissing(images(), 0, grid_);
  ASSERT_TRUE(missing) << missing.error().message;
  ASSERT_EQ(missing->size(), 1U);
  const glm::uvec3 p = points.front();
  EXPECT_EQ(missing->front().gaps, (std::vector<Gap>{{{p.x, p.y, p.z, 0}, {p.x, p.y, p.z, 5}, 6}}));
}

TEST_F(ShardedTest, aShardWithoutASelectedPointLacksNothing) {
  SampleTree tree(grid_, 4);
  for (const glm::uvec3& p : tree.points())
    if (p != glm::uvec3(0)) tree.leaveOut(p);
  const auto missing = findMissing(images(), 3, grid_, &tree);
  ASSERT_TRUE(missing) << missing.error().message;
  ASSERT_EQ(missing->size(), 1U);
  EXPECT_EQ(missing->front().shard, (Shard{0, 3}));
  EXPECT_EQ(missing->front().faces, 6U);
}

// The writer may run on another machine, whose LMDB does not know of our readers.
TEST_F(ShardedTest, aShardThatIsBeingWrittenCountsAsMissing) {
  for (std::uint32_t i = 0; i < 3; ++i) makeShard(i);
  {
    test::WriterProcess writer({shardPath(1), "0", "1000000"});
    ASSERT_TRUE(writer.nextCommitted());
    EXPECT_TRUE(isBeingWritten(shardPath(1)));
    EXPECT_FALSE(isBeingWritten(shardPath(0)));
    const auto missing = findMissing(images(), 3, grid_);
    ASSERT_TRUE(missing);
    ASSERT_EQ(missing->size(), 1U);
    EXPECT_TRUE(missing->front().being_written);
    EXPECT_EQ(missing->front().shard, (Shard{1, 3}));
    EXPECT_EQ(missing->front().faces, 60U);
  }
  EXPECT_FALSE(isBeingWritten(shardPath(1)));
  EXPECT_FALSE(isBeingWritten(images()));
  EXPECT_TRUE(findMissing(images(), 3, grid_)->empty());
}

TEST_F(ShardedTest, imagesOfAnotherGridAreRefused) {
  makeShard(0);
  Grid other = grid_;
  other.count.x = 4;
  const auto refused = findMissing(images(), 3, other);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("another grid"), std::string::npos);
}

TEST_F(ShardedTest, aStoreIsRemovedUnlessSomebodyWritesIt) {
  makeShard(0);
  {
    test::WriterProcess writer({shardPath(0), "0", "1000000"});
    ASSERT_TRUE(writer.nextCommitted());
    const auto refused = removeLmdbStore(shardPath(0));
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, base::ErrorCode::kBusy);
    EXPECT_TRUE(isLmdbStore(shardPath(0)));
  }
  EXPECT_TRUE(removeLmdbStore(shardPath(0)));
  EXPECT_FALSE(std::filesystem::exists(shardPath(0)));
  EXPECT_TRUE(removeLmdbStore(shardPath(0))) << "there is nothing to remove";
  makeShard(1);
  std::filesystem::create_directories(shardPath(1) + "/precious");
  EXPECT_TRUE(removeLmdbStore(shardPath(1)));
  EXPECT_TRUE(std::filesystem::exists(shardPath(1) + "/precious"));
}

}  // namespace
}  // namespace repository
