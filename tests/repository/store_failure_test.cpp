// The store must survive killed writers, full disks and damaged files.
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <cstring>
#include <fstream>
#include <random>
#include <set>
#include <thread>

#include "base/file.h"
#include "repository/store.h"
#include "tests/repository/sample_values.h"
#include "tests/repository/writer_process.h"
#include "tests/support/temporary_directory.h"

// LMDB allocates a transaction before it reads what may fault.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:mdb_txn_begin\n";
}

namespace repository {
namespace {

using support::TemporaryDirectory;
using test::batchOf;
using test::kBatchValues;
using test::keyOf;
using test::valueOf;
using test::WriterProcess;

std::unique_ptr<Store> mustOpen(const std::string& path, StoreMode mode, const LmdbOptions& options = {}) {
  auto store = openLmdbStore(path, mode, options);
  if (store) return std::move(*store);
  ADD_FAILURE() << store.error().message;
  return nullptr;
}

// Counts the values of the batch that are in the store; each must be whole.
std::uint32_t wholeValuesOf(const Store& store, std::uint32_t batch) {
  std::uint32_t count = 0;
  for (const auto& [key, expected] : batchOf(batch)) {
    const auto value = store.get(key);
    if (!value) ADD_FAILURE() << value.error().message;
    if (!value || !*value) continue;
    EXPECT_EQ(**value, expected);
    ++count;
  }
  return count;
}

TEST(StoreFailure, aKilledWriterLosesNothingCommitted) {
  const TemporaryDirectory directory;
  std::mt19937 random(2011);
  std::uint32_t next = 0;
  std::set<std::uint32_t> committed;
  for (int round = 0; round < 10; ++round) {
    {
      WriterProcess writer({directory / "images", std::to_string(next), "1000000"});
      const std::uint32_t acknowledgements = 1 + static_cast<std::uint32_t>(random() % 3);
      for (std::uint32_t i = 0; i < acknowledgements; ++i) {
        const auto batch = writer.nextCommitted();
        ASSERT_TRUE(batch) << "the writer ended by itself";
        committed.insert(*batch);
      }
      ::usleep(static_cast<useconds_t>(random() % 3000));  // anywhere within the next batches
      writer.kill();
      while (const auto batch = writer.nextCommitted()) committed.insert(*batch);
    }

    // All batches that it reported are there, and the batch in flight is there whole or not at all.
    const auto store = mustOpen(directory / "images", StoreMode::kRead);
    for (const std::uint32_t batch : committed) ASSERT_EQ(wholeValuesOf(*store, batch), kBatchValues) << batch;
    const std::uint32_t in_flight = *committed.rbegin() + 1;
    const std::uint32_t there = wholeValuesOf(*store, in_flight);
    EXPECT_TRUE(there == 0 || there == kBatchValues) << there;
    EXPECT_EQ(*store->size(), committed.size() * kBatchValues + there);
    if (there != 0) committed.insert(in_flight);
    next = *committed.rbegin() + 1;
  }
  EXPECT_TRUE(mustOpen(directory / "images", StoreMode::kWrite)->putBatch(batchOf(next)));
}

TEST(StoreFailure, readersSeeOnlyWholeValuesWhileAnotherProcessWrites) {
  const TemporaryDirectory directory;
  // Both start with a small map, so that the writer makes it larger while the reader has it open.
  WriterProcess writer({directory / "images", "0", "30", "262144"});
  ASSERT_TRUE(writer.nextCommitted());
  const auto store = mustOpen(directory / "images", StoreMode::kRead, {262144});
  std::uint32_t last = 0;
  while (const auto batch = writer.nextCommitted()) {
    last = *batch;
    ASSERT_EQ(wholeValuesOf(*store, last), kBatchValues);
    const std::uint32_t next = wholeValuesOf(*store, last + 1);
    (void)next;  // any number: batches commit between the reads; wholeness is what was checked
  }
  EXPECT_EQ(last, 29U);
  EXPECT_EQ(writer.wait(), 0);
  EXPECT_EQ(*store->size(), 30 * kBatchValues);
}

// How many values are right, and how many reads fail; nothing else may happen.
struct Answers {
  std::uint32_t right = 0, failed = 0;
};
Answers askForAll(const Store& store, std::uint32_t batches) {
  Answers answers;
  for (std::uint32_t batch = 0; batch < batches; ++batch)
    for (const auto& [key, expected] : batchOf(batch)) {
      const auto value = store.get(key);
      const auto bytes = store.valueBytes(key);
      if (!value) {
        ++answers.failed;
        EXPECT_EQ(value.error().code, base::ErrorCode::kIo);
        EXPECT_NE(value.error().message.find("/data.mdb: a read failed: the file was cut or the disk fails"),
                  std::string::npos)
            << value.error().message;
        EXPECT_FALSE(bytes) << "once it has failed it stays so";
      } else if (*value && **value == expected) {
        ++answers.right;
      }
    }
  return answers;
}

TEST(StoreFailure, aFileThatIsCutWhileItIsOpenIsAnErrorUntilItIsOpenedAnew) {
  constexpr std::uint32_t kBatches = 10, kValues = kBatches * kBatchValues;
  const TemporaryDirectory directory;
  const std::string path = directory / "images";
  {
    const auto writer = mustOpen(path, StoreMode::kWrite);
    for (std::uint32_t batch = 0; batch < kBatches; ++batch) ASSERT_TRUE(writer->putBatch(batchOf(batch)));
    ASSERT_TRUE(writer->writeMeta("{}"));
  }
  const base::Bytes whole = *base::readFile(path + "/data.mdb");
  for (const char* name : {"data.mdb", "lock.mdb"})
    for (const int divisor : {2, 0}) {
      const std::string file = path + "/" + name;
      const auto store = mustOpen(path, StoreMode::kRead);
      ASSERT_EQ(askForAll(*store, kBatches).right, kValues);
      std::filesystem::resize_file(file, divisor == 0 ? 0 : std::filesystem::file_size(file) / 2);

      const bool can_be_read = std::string(name) == "lock.mdb" && divisor != 0;  // readers' places stand in front
      const Answers answers = askForAll(*store, kBatches);
      EXPECT_EQ(answers.failed == 0, can_be_read) << file;
      EXPECT_EQ(answers.right == kValues, can_be_read) << file;
      EXPECT_EQ(bool(store->size()), can_be_read);
      EXPECT_EQ(bool(store->readMeta()), can_be_read);
      EXPECT_EQ(bool(store->forEach([](const FaceKey&, base::ByteView) { return true; })), can_be_read);
      EXPECT_EQ(bool(store->forEachKey([](const FaceKey&) { return true; })), can_be_read);

      // Whole again it can be opened anew, beside the handle that has failed.
      ASSERT_TRUE(base::writeFileAtomically(path + "/data.mdb", whole));
      const auto again = mustOpen(path, StoreMode::kRead);
      ASSERT_NE(again, nullptr);
      EXPECT_EQ(askForAll(*again, kBatches).right, kValues);
      EXPECT_EQ(bool(store->size()), can_be_read);
    }
}

TEST(StoreFailure, threadsThatReadAFileThatIsCutGetErrors) {
  constexpr std::uint32_t kBatches = 5;
  const TemporaryDirectory directory;
  const std::string path = directory / "images";
  {
    const auto writer = mustOpen(path, StoreMode::kWrite);
    for (std::uint32_t batch = 0; batch < kBatches; ++batch) ASSERT_TRUE(writer->putBatch(batchOf(batch)));
  }
  const auto store = mustOpen(path, StoreMode::kRead);
  std::atomic<std::uint32_t> failed{0};
  std::vector<std::thread> readers;
  for (int t = 0; t < 4; ++t)
    readers.emplace_back([&] {
      while (askForAll(*store, kBatches).failed == 0) {
      }
      ++failed;
    });
  std::filesystem::resize_file(path + "/data.mdb", 4096);
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(failed, 4U);
}

TEST(StoreFailure, writingIntoAFileThatIsCutIsAnError) {
  const TemporaryDirectory directory;
  const std::string path = directory / "images";
  const auto store = mustOpen(path, StoreMode::kWrite);
  for (std::uint32_t batch = 0; batch < 5; ++batch) ASSERT_TRUE(store->putBatch(batchOf(batch)));
  std::filesystem::resize_file(path + "/data.mdb", 0);
  const auto put = store->putBatch(batchOf(5));
  ASSERT_FALSE(put);
  EXPECT_EQ(put.error().code, base::ErrorCode::kIo) << put.error().message;
  EXPECT_FALSE(store->putBatch(batchOf(6)));
  EXPECT_FALSE(store->erase({keyOf(0)}));
}

TEST(StoreFailure, aWriterOfAnotherProcessIsNamedByItsPid) {
  const TemporaryDirectory directory;
  WriterProcess writer({directory / "images", "0", "1000000"});
  ASSERT_TRUE(writer.nextCommitted());
  const auto second = openLmdbStore(directory / "images", StoreMode::kWrite);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, base::ErrorCode::kBusy);
  EXPECT_NE(second.error().message.find("(pid "), std::string::npos);
  writer.kill();
  EXPECT_TRUE(openLmdbStore(directory / "images", StoreMode::kWrite)) << "a dead writer's lock must not stay";
}

// Writes until it fails. The values committed before must still be there, and writing must work again once there is
// room.
void expectNoSpaceAndSoundStore(const std::string& path, const std::function<void()>& make_room) {
  auto store = mustOpen(path, StoreMode::kWrite);
  ASSERT_NE(store, nullptr);
  std::uint32_t committed = 0;
  base::Result<void> put;
  for (; committed < 100 && put; ++committed) put = store->putBatch(batchOf(committed));
  --committed;
  ASSERT_FALSE(put) << "no limit was met";
  EXPECT_EQ(put.error().code, base::ErrorCode::kNoSpace) << put.error().message;
  EXPECT_NE(put.error().message.find("run the same command again"), std::string::npos) << put.error().message;
  EXPECT_GT(committed, 0U);

  for (int again = 0; again < 2; ++again) {
    for (std::uint32_t batch = 0; batch < committed; ++batch) ASSERT_EQ(wholeValuesOf(*store, batch), kBatchValues);
    EXPECT_EQ(wholeValuesOf(*store, committed), 0U);
    store.reset();
    store = mustOpen(path, again == 0 ? StoreMode::kRead : StoreMode::kWrite);
    ASSERT_NE(store, nullptr);
  }
  make_room();
  EXPECT_TRUE(store->putBatch(batchOf(committed)));
  EXPECT_EQ(wholeValuesOf(*store, committed), kBatchValues);
}

TEST(StoreFailure, aFullDiskIsNoSpaceAndTheStoreStaysSound) {
  const TemporaryDirectory directory;
  const std::string disk = directory / "disk";
  std::filesystem::create_directory(disk);
  if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=3m") != 0)
    GTEST_SKIP() << "this user may not mount a small disk";
  expectNoSpaceAndSoundStore(disk + "/images",
                             [&] { EXPECT_EQ(::mount("tmpfs", disk.c_str(), "tmpfs", MS_REMOUNT, "size=20m"), 0); });
  EXPECT_EQ(::umount(disk.c_str()), 0);
}

TEST(StoreFailure, aLimitOnFileSizeIsNoSpaceAndTheStoreStaysSound) {
  const TemporaryDirectory directory;
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  rlimit small = before;
  small.rlim_cur = 3 << 20;
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  expectNoSpaceAndSoundStore(directory / "images", [&] { ::setrlimit(RLIMIT_FSIZE, &before); });
  ::setrlimit(RLIMIT_FSIZE, &before);
}

// ---- Damaged files ----

void writeFile(const std::string& path, const base::Bytes& bytes) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

base::Bytes smallStore(const TemporaryDirectory& directory) {
  {
    const auto store = mustOpen(directory / "good", StoreMode::kWrite);
    for (std::uint32_t batch = 0; batch < 6; ++batch) EXPECT_TRUE(store->putBatch(batchOf(batch)));
    for (std::uint32_t number = 0; number < 100; number += 2)
      EXPECT_TRUE(store->erase({keyOf(number)}));  // so there are free pages
    EXPECT_TRUE(store->writeMeta("parameters"));
  }
  return *base::readFile(directory / "good/data.mdb");
}

// Opens, reads and writes as far as possible. Returns whether something was refused or came back changed.
bool useDamaged(const TemporaryDirectory& directory, const base::Bytes& bytes) {
  const std::string path = directory / "damaged";
  std::filesystem::remove_all(path);
  std::filesystem::create_directory(path);
  writeFile(path + "/data.mdb", bytes);
  bool noticed = false;
  for (const StoreMode mode : {StoreMode::kRead, StoreMode::kWrite}) {
    const auto store = openLmdbStore(path, mode);
    if (!store) {
      EXPECT_NE(store.error().message.find(path), std::string::npos);
      EXPECT_EQ(store.error().message.find('\n'), std::string::npos);
      noticed = true;
      continue;
    }
    std::uint32_t whole = 0;
    const auto walked = (*store)->forEach([&](const FaceKey&, base::ByteView value) {
      whole += decodeFaceValue(value) ? 1 : 0;
      return true;
    });
    noticed = noticed || !walked || whole != 6 * kBatchValues - 50;
    for (std::uint32_t number = 0; number < 50; ++number) (void)(*store)->get(keyOf(number));
    (void)(*store)->readMeta();
    if (mode == StoreMode::kWrite) {
      (void)(*store)->erase({keyOf(1), keyOf(55), keyOf(101)});
      (void)(*store)->putBatch(batchOf(2));
      (void)(*store)->putBatch(batchOf(9));
    }
  }
  return noticed;
}

TEST(StoreFailure, theWholeFileIsAccepted) {
  const TemporaryDirectory directory;
  EXPECT_FALSE(useDamaged(directory, smallStore(directory)));
}

TEST(StoreFailure, aTruncatedFileIsAnErrorAndNeverACrash) {
  const TemporaryDirectory directory;
  const base::Bytes good = smallStore(directory);
  std::mt19937 random(5);
  for (int i = 0; i < 40; ++i) {
    const std::size_t size = i < 8 ? 1 + 2400 * static_cast<std::size_t>(i) : random() % good.size();
    EXPECT_TRUE(useDamaged(directory, base::Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size))))
        << size;
  }
}

// A writer would put its next page there, terabytes behind the end of the file.
TEST(StoreFailure, aFreePageBehindTheLastIsRefused) {
  const TemporaryDirectory directory;
  base::Bytes bytes = smallStore(directory);
  const auto at = [&](std::size_t offset) {
    std::uint64_t number = 0;
    std::memcpy(&number, &bytes[offset], sizeof(number));
    return number;
  };
  // The first value of the free list, whose root the newer meta page names (lmdb_environment.cpp has the layout).
  // layout).
  const std::size_t meta = at(144) > at(4096 + 144) ? 0 : 4096;
  const std::size_t leaf = 4096 * at(meta + 80);
  ASSERT_LT(leaf, bytes.size());
  ASSERT_EQ(bytes[leaf + 10], 2) << "no leaf";
  const std::size_t value = leaf + bytes[leaf + 16] + 256U * bytes[leaf + 17] + 16;
  ASSERT_GT(at(value), 0U) << "no page is free";
  const std::uint64_t far = std::uint64_t{1} << 32;
  std::memcpy(&bytes[value + 8], &far, sizeof(far));

  std::filesystem::create_directory(directory / "far");
  writeFile(directory / "far/data.mdb", bytes);
  const auto store = openLmdbStore(directory / "far", StoreMode::kWrite);
  ASSERT_FALSE(store);
  EXPECT_NE(store.error().message.find("a free page out of the file"), std::string::npos) << store.error().message;
}

TEST(StoreFailure, aFileOfOtherBytesIsAnError) {
  const TemporaryDirectory directory;
  std::mt19937 random(6);
  base::Bytes bytes(100000);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  EXPECT_TRUE(useDamaged(directory, bytes));
  EXPECT_TRUE(useDamaged(directory, base::Bytes(100000, 0)));
}

// Half of the flips hit the first 200 bytes of a page, which hold its header and the offsets of its nodes; the others
// hit anywhere.
TEST(StoreFailure, flippedBitsNeverCrash) {
  const TemporaryDirectory directory;
  const base::Bytes good = smallStore(directory);
  std::mt19937 random(7);
  std::vector<std::size_t> pages_of_keys;  // branch or leaf, by their flags
  for (std::size_t at = 0; at + 4096 <= good.size(); at += 4096) {
    if (at < 8192 || ((good[at + 10] & 3) != 0 && good[at + 11] == 0)) pages_of_keys.push_back(at);
  }
  int noticed = 0;
  for (int i = 0; i < 120; ++i) {
    base::Bytes bytes = good;
    for (int flips = 0; flips < 1 + i % 3; ++flips) {
      const std::size_t page =
          i % 4 == 3 ? random() % good.size() / 4096 * 4096 : pages_of_keys[random() % pages_of_keys.size()];
      const std::size_t at = page + random() % (i % 4 == 0 ? 24 : 4096);
      bytes[at % bytes.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    }
    noticed += useDamaged(directory, bytes) ? 1 : 0;
  }
  EXPECT_GT(noticed, 25);  // most flips hit unused parts of a page, or a value, whose checksum tells
}

}  // namespace
}  // namespace repository
