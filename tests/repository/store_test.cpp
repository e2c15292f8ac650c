#include "repository/store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <random>
#include <thread>

#include "repository/lmdb_environment.h"
#include "tests/repository/sample_values.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

using support::TemporaryDirectory;
using test::batchOf;
using test::keyOf;
using test::valueOf;

std::unique_ptr<Store> mustOpen(const std::string& path, StoreMode mode, const LmdbOptions& options = {}) {
  auto store = openLmdbStore(path, mode, options);
  if (store) return std::move(*store);
  ADD_FAILURE() << store.error().message;
  return nullptr;
}

TEST(LmdbStore, valuesComeBackAlsoAfterReopening) {
  const TemporaryDirectory directory;
  {
    const auto store = mustOpen(directory / "images", StoreMode::kWrite);
    ASSERT_TRUE(store->putBatch(batchOf(0)));
    EXPECT_EQ(**store->get(keyOf(3)), valueOf(3));
  }
  const auto store = mustOpen(directory / "images", StoreMode::kRead);
  for (std::uint32_t number = 0; number < test::kBatchValues; ++number) {
    const auto value = store->get(keyOf(number));
    ASSERT_TRUE(value);
    ASSERT_TRUE(value->has_value());
    EXPECT_EQ(**value, valueOf(number));
    EXPECT_EQ(*store->valueBytes(keyOf(number)), valueOf(number).size());
  }
  EXPECT_EQ(*store->size(), test::kBatchValues);
}

TEST(LmdbStore, anAbsentKeyIsNoError) {
  const TemporaryDirectory directory;
  const auto store = mustOpen(directory / "images", StoreMode::kWrite);
  const auto value = store->get({1, 2, 3, 4});
  ASSERT_TRUE(value);
  EXPECT_FALSE(value->has_value());
  EXPECT_FALSE(*store->contains({1, 2, 3, 4}));
  EXPECT_EQ(*store->size(), 0U);
}

TEST(LmdbStore, forEachVisitsInMortonOrderWhateverTheOrderOfWriting) {
  const TemporaryDirectory directory;
  const auto store = mustOpen(directory / "images", StoreMode::kWrite);
  for (const std::uint32_t batch : {5U, 1U, 9U, 0U, 7U, 3U, 2U, 8U}) ASSERT_TRUE(store->putBatch(batchOf(batch)));
  std::vector<FaceKey> keys;
  ASSERT_TRUE(store->forEach([&](const FaceKey& key, base::ByteView value) {
    EXPECT_TRUE(decodeFaceValue(value));
    keys.push_back(key);
    return true;
  }));
  EXPECT_EQ(keys.size(), 8 * test::kBatchValues);  // more than one portion
  EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
  EXPECT_EQ(std::adjacent_find(keys.begin(), keys.end()), keys.end());
}

TEST(LmdbStore, forEachStopsWhenToldAndAllowsReadsAndWrites) {
  const TemporaryDirectory directory;
  const auto store = mustOpen(directory / "images", StoreMode::kWrite);
  ASSERT_TRUE(store->putBatch(batchOf(0)));
  int visited = 0;
  ASSERT_TRUE(store->forEach([&](const FaceKey& key, base::ByteView value) {
    const auto same = store->get(key);
    EXPECT_TRUE(std::equal(value.begin(), value.end(), (*same)->begin(), (*same)->end()));
    EXPECT_TRUE(store->putBatch({{key, valueOf(77)}}));
    return ++visited < 5;
  }));
  EXPECT_EQ(visited, 5);
}

TEST(LmdbStore, aSecondValueReplacesTheFirstAndTheLastInABatchStays) {
  const TemporaryDirectory directory;
  const auto store = mustOpen(directory / "images", StoreMode::kWrite);
  ASSERT_TRUE(store->putBatch({{{1, 1, 1, 1}, valueOf(1)}}));
  ASSERT_TRUE(store->putBatch({{{1, 1, 1, 1}, valueOf(2)}, {{0, 0, 0, 0}, valueOf(3)}, {{1, 1, 1, 1}, valueOf(4)}}));
  EXPECT_EQ(**store->get({1, 1, 1, 1}), valueOf(4));
  EXPECT_EQ(*store->size(), 2U);
}

TEST(LmdbStore, erasedKeysAreGoneAndOthersStay) {
  const TemporaryDirectory directory;
  const auto store = mustOpen(directory / "images", StoreMode::kWrite);
  ASSERT_TRUE(store->putBatch(batchOf(0)));
  ASSERT_TRUE(store->erase({keyOf(1), keyOf(2), {900, 900, 900, 5}}));
  EXPECT_EQ(*store->size(), test::kBatchValues - 2);
  EXPECT_FALSE(*store->contains(keyOf(1)));
  EXPECT_TRUE(*store->contains(keyOf(3)));
}

TEST(LmdbStore, parametersAreKeptBesideTheFaces) {
  const TemporaryDirectory directory;
  {
    const auto store = mustOpen(directory / "images", StoreMode::kWrite);
    EXPECT_FALSE(store->readMeta()->has_value());
    ASSERT_TRUE(store->writeMeta("{\"face\": 512}\n"));
  }
  const auto store = mustOpen(directory / "images", StoreMode::kRead);
  EXPECT_EQ(**store->readMeta(), "{\"face\": 512}\n");
  EXPECT_EQ(*store->size(), 0U);
}

TEST(LmdbStore, aSecondWriterIsRefusedByName) {
  const TemporaryDirectory directory;
  auto first = mustOpen(directory / "images", StoreMode::kWrite);
  const auto second = openLmdbStore(directory / "images", StoreMode::kWrite);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, base::ErrorCode::kBusy);
  EXPECT_NE(second.error().message.find("is being written by another process (pid " + std::to_string(::getpid()) + ")"),
            std::string::npos)
      << second.error().message;
  first.reset();
  EXPECT_TRUE(openLmdbStore(directory / "images", StoreMode::kWrite));
}

TEST(LmdbStore, aReaderBesideAWriterSeesCommittedValues) {
  const TemporaryDirectory directory;
  auto writer = mustOpen(directory / "images", StoreMode::kWrite);
  std::filesystem::create_directory_symlink(directory / "images", directory / "other_name");
  const auto reader = mustOpen(directory / "other_name", StoreMode::kRead);
  EXPECT_FALSE(*reader->contains(keyOf(0)));
  ASSERT_TRUE(writer->putBatch(batchOf(0)));
  EXPECT_TRUE(*reader->contains(keyOf(0)));
  writer.reset();
  EXPECT_TRUE(*reader->contains(keyOf(0)));
}

TEST(LmdbStore, aReaderOpenedFirstDoesNotKeepAWriterOut) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(mustOpen(directory / "images", StoreMode::kWrite)->putBatch(batchOf(0)));
  const auto reader = mustOpen(directory / "images", StoreMode::kRead);
  const auto writer = mustOpen(directory / "images", StoreMode::kWrite);
  ASSERT_TRUE(writer->putBatch(batchOf(1)));
  EXPECT_TRUE(*reader->contains(keyOf(test::kBatchValues)));
}

TEST(LmdbStore, aReadersHandleRefusesToWrite) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(mustOpen(directory / "images", StoreMode::kWrite)->putBatch(batchOf(0)));
  const auto store = mustOpen(directory / "images", StoreMode::kRead);
  EXPECT_FALSE(store->putBatch(batchOf(1)));
  EXPECT_FALSE(store->erase({keyOf(0)}));
  EXPECT_FALSE(store->writeMeta("x"));
  EXPECT_EQ(*store->size(), test::kBatchValues);
}

TEST(LmdbStore, openingAnAbsentStoreForReadingIsNotFound) {
  const TemporaryDirectory directory;
  for (const std::string& name : {std::string("images"), std::string("")}) {
    const auto store = openLmdbStore(directory / name, StoreMode::kRead);
    ASSERT_FALSE(store);
    EXPECT_EQ(store.error().code, base::ErrorCode::kNotFound);
  }
  EXPECT_TRUE(std::filesystem::is_empty(directory.path()));
}

TEST(LmdbStore, theMapGrowsWhenItIsFull) {
  const TemporaryDirectory directory;
  const auto store = mustOpen(directory / "images", StoreMode::kWrite, {std::uint64_t{256} << 10});
  for (std::uint32_t batch = 0; batch < 12; ++batch) ASSERT_TRUE(store->putBatch(batchOf(batch)));  // about 5 MB
  for (std::uint32_t number = 0; number < 12 * test::kBatchValues; ++number)
    ASSERT_EQ(**store->get(keyOf(number)), valueOf(number));
}

TEST(LmdbStore, manyThreadsReadWhileOneWritesAndTheMapGrows) {
  const TemporaryDirectory directory;
  const auto store = mustOpen(directory / "images", StoreMode::kWrite, {std::uint64_t{256} << 10});
  ASSERT_TRUE(store->putBatch(batchOf(0)));
  std::atomic<bool> stop{false};
  std::atomic<std::uint32_t> torn{0};
  std::atomic<std::uint32_t> found{0};
  std::vector<std::thread> readers;
  for (unsigned t = 0; t < 4; ++t) {
    readers.emplace_back([&, t] {
      std::mt19937 random(t);
      do {
        const auto number = static_cast<std::uint32_t>(random() % (10 * test::kBatchValues));
        const auto value = store->get(keyOf(number));
        if (!value || (*value && **value != valueOf(number))) ++torn;
        if (value && *value) ++found;
      } while (!stop);
    });
  }
  for (std::uint32_t batch = 1; batch < 10; ++batch) EXPECT_TRUE(store->putBatch(batchOf(batch)));
  stop = true;
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(torn, 0U);
  EXPECT_GT(found, 0U);
}

// No writer makes such keys. The error must say what to do about one.
TEST(LmdbStore, anInvalidKeyIsNamedWithWhatToDo) {
  for (const std::string& key : {std::string("abc"), std::string("\0\0\0\0\0\0\x38\0", 8)}) {
    const TemporaryDirectory directory;
    const auto store = mustOpen(directory / "images", StoreMode::kWrite);
    auto environment = LmdbEnvironment::open(std::filesystem::canonical(directory / "images").string(), {});
    ASSERT_TRUE(environment);
    ASSERT_EQ((*environment)->write([&](MDB_txn* txn) {
      return (*environment)->put(txn, 0, repository::valueOf(key), repository::valueOf(key));
    }),
              0);
    const auto walked = store->forEach([](const FaceKey&, base::ByteView) { return true; });
    ASSERT_FALSE(walked);
    EXPECT_EQ(walked.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_NE(walked.error().message.find("images: "), std::string::npos) << walked.error().message;
    EXPECT_NE(walked.error().message.find("build the images again"), std::string::npos) << walked.error().message;
  }
}

}  // namespace
}  // namespace repository
