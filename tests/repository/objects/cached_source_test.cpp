#include "repository/objects/cached_source.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <random>
#include <thread>

#include "base/file.h"
#include "tests/repository/made_object.h"
#include "tests/repository/writer_process.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

using base::Bytes;
using base::ErrorCode;
using support::TemporaryDirectory;

constexpr std::uint64_t kBlock = CachedSource::kBlockBytes;

Bytes sample(std::size_t size, std::uint8_t salt = 0) {
  Bytes bytes(size);
  std::minstd_rand random(salt + 1U);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random() >> 8);
  return bytes;
}

// Serves remote objects from memory, records the reads and can hold them back.
class Far final : public ObjectSource {
 public:
  base::Result<Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override {
    std::unique_lock lock(mutex_);
    ++reads;
    changed_.notify_all();
    changed_.wait(lock, [&] { return !held_; });
    const auto it = objects.find(name);
    if (broken || it == objects.end()) return base::Error{ErrorCode::kNetwork, "far: " + name + ": gone"};
    if (offset > it->second.size() || length > it->second.size() - offset)
      return base::Error{ErrorCode::kInvalidInput, "far: too short"};
    const auto begin = it->second.begin() + static_cast<std::ptrdiff_t>(offset);
    return Bytes(begin, begin + static_cast<std::ptrdiff_t>(length));
  }
  base::Result<std::uint64_t> size(const std::string& name) const override {
    const std::lock_guard lock(mutex_);
    ++sizes;
    const auto it = objects.find(name);
    if (it == objects.end()) return base::Error{ErrorCode::kNotFound, "far: " + name + ": not there"};
    return it->second.size();
  }
  const std::string& place() const override { return place_; }

  void hold(bool held) {
    const std::lock_guard lock(mutex_);
    held_ = held;
    changed_.notify_all();
  }
  void waitForReads(int count) const {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return reads >= count; });
  }

  std::map<std::string, Bytes> objects;
  bool broken = false;
  mutable int reads = 0, sizes = 0;

 private:
  std::string place_ = "far://scene";
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  bool held_ = false;
};

struct Fixture {
  explicit Fixture(std::uint64_t budget = std::uint64_t{64} << 20) {
    options.bytes = budget;
    options.warn = [this](const std::string& line) { warnings.push_back(line); };
    far->objects["pack"] = sample(10 * kBlock + 100);
  }
  std::unique_ptr<CachedSource> open(const std::string& directory) {
    auto cached = CachedSource::open(far, directory, options);
    if (cached) return std::move(*cached);
    ADD_FAILURE() << cached.error().message;
    return nullptr;
  }
  void expectRead(const CachedSource& cached, const std::string& name, std::uint64_t offset, std::uint64_t length) {
    const auto bytes = cached.read(name, offset, length);
    ASSERT_TRUE(bytes) << bytes.error().message;
    const Bytes& whole = far->objects[name];
    ASSERT_EQ(bytes->size(), length);
    EXPECT_TRUE(std::equal(bytes->begin(), bytes->end(), whole.begin() + static_cast<std::ptrdiff_t>(offset)));
  }
  std::shared_ptr<Far> far = std::make_shared<Far>();
  RangeCacheOptions options;
  std::vector<std::string> warnings;
};

TEST(CachedSource, anyRangeEqualsTheSourcesBytesTwice) {
  const TemporaryDirectory directory;
  Fixture f;
  const auto cached = f.open(directory.path());
  const std::uint64_t size = f.far->objects["pack"].size();
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    const std::uint64_t offset = random() % size;
    f.expectRead(*cached, "pack", offset, 1 + random() % (size - offset));
  }
  f.expectRead(*cached, "pack", 0, size);
  f.expectRead(*cached, "pack", size - 1, 1);
  f.expectRead(*cached, "pack", kBlock - 1, 2);
  f.expectRead(*cached, "pack", size, 0);
  EXPECT_EQ(cached->counts().blocks_fetched, 11U);
  EXPECT_EQ(f.far->sizes, 1);
  EXPECT_TRUE(f.warnings.empty());
}

TEST(CachedSource, aGapIsFetchedByOneRead) {
  const TemporaryDirectory directory;
  Fixture f;
  const auto cached = f.open(directory.path());
  f.expectRead(*cached, "pack", 4 * kBlock, 10);
  f.expectRead(*cached, "pack", 0, 10 * kBlock);  // before it and behind it
  EXPECT_EQ(f.far->reads, 3);
  EXPECT_EQ(cached->counts().blocks_fetched, 10U);
}

TEST(CachedSource, rangesBeyondTheEndAreErrors) {
  const TemporaryDirectory directory;
  Fixture f;
  const auto cached = f.open(directory.path());
  const std::uint64_t size = f.far->objects["pack"].size();
  EXPECT_EQ(cached->read("pack", size, 1).error().code, ErrorCode::kInvalidInput);
  EXPECT_EQ(cached->read("pack", ~std::uint64_t{0}, 1).error().code, ErrorCode::kInvalidInput);
  EXPECT_EQ(cached->read("pack", 1, ~std::uint64_t{0}).error().code, ErrorCode::kInvalidInput);
  EXPECT_EQ(cached->read("none", 0, 1).error().code, ErrorCode::kNotFound);
  f.far->broken = true;
  EXPECT_EQ(cached->read("pack", 0, 1).error().code, ErrorCode::kNetwork);
  f.far->broken = false;  // an error is not kept
  f.expectRead(*cached, "pack", 0, 1);
}

TEST(CachedSource, cachedBlocksSurviveAndNeedNoSource) {
  const TemporaryDirectory directory;
  Fixture f;
  f.expectRead(*f.open(directory.path()), "pack", 0, 3 * kBlock);
  f.far->broken = true;
  const auto again = f.open(directory.path());
  f.expectRead(*again, "pack", 100, 2 * kBlock);
  EXPECT_EQ(again->counts().blocks_fetched, 0U);
  EXPECT_EQ(f.far->sizes, 1);
}

TEST(CachedSource, namesAreKeptApart) {
  const TemporaryDirectory directory;
  Fixture f;
  f.far->objects["other"] = sample(kBlock, 1);
  const auto cached = f.open(directory.path());
  f.expectRead(*cached, "pack", 0, 10);
  f.expectRead(*cached, "other", 0, 10);
}

TEST(CachedSource, aBlockIsFetchedOnceForAllThreads) {
  const TemporaryDirectory directory;
  Fixture f;
  const auto cached = f.open(directory.path());
  EXPECT_TRUE(cached->size("pack"));
  f.far->hold(true);
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) threads.emplace_back([&] { f.expectRead(*cached, "pack", 10, 20); });
  f.far->waitForReads(1);
  // All other threads wait for this fetch, or will find its block.
  while (cached->counts().blocks_shared < 7) std::this_thread::yield();
  f.far->hold(false);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(f.far->reads, 1);
}

TEST(CachedSource, threadsWithCrossingRangesDoNotWaitForEachOther) {
  const TemporaryDirectory directory;
  Fixture f;
  const auto cached = f.open(directory.path());
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      std::mt19937 random(t);
      for (int i = 0; i < 50; ++i) f.expectRead(*cached, "pack", random() % (5 * kBlock), 1 + random() % (5 * kBlock));
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(cached->counts().blocks_fetched, 10U);
}

TEST(CachedSource, anErrorReachesAllWaitingThreads) {
  const TemporaryDirectory directory;
  Fixture f;
  const auto cached = f.open(directory.path());
  EXPECT_TRUE(cached->size("pack"));
  f.far->broken = true;
  f.far->hold(true);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] { EXPECT_EQ(cached->read("pack", 10, 20).error().code, ErrorCode::kNetwork); });
  while (cached->counts().blocks_shared < 3) std::this_thread::yield();
  f.far->hold(false);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(f.far->reads, 1);
}

TEST(CachedSource, blocksHaveTheDocumentedKeys) {
  const TemporaryDirectory directory;
  Fixture f;
  const auto cached = f.open(directory.path());
  f.expectRead(*cached, "pack", 0, 1);
  // The worked example of docs/formats/cache.md has the SHA-256 of "far://scene\n\npack\n0".
  const CacheKey key{0xd7, 0x17, 0x7d, 0xea, 0xd8, 0x17, 0xe4, 0xbe, 0x01, 0x1d, 0x4a, 0xbf, 0x7e, 0x2d, 0x39, 0xf1};
  const auto block = cached->cache().get(key);
  ASSERT_TRUE(block);
  EXPECT_EQ(block->size(), kBlock);
  EXPECT_TRUE(std::equal(block->begin(), block->end(), f.far->objects["pack"].begin()));
  // The cost of the block and of the object's size.
  EXPECT_EQ(cached->cache().usedBytes(), 65696U + 4096U + 160U);
}

// --- Bounds

TEST(RangeCache, evictsTheLeastRecentlyUsedFirst) {
  const TemporaryDirectory directory;
  Fixture f(20 * (kBlock + 200));
  f.far->objects["big"] = sample(200 * kBlock);
  f.expectRead(*f.open(directory.path()), "pack", 0, 3 * kBlock);
  const auto cached = f.open(directory.path());
  for (std::uint64_t i = 0; i < 200; ++i) {
    f.expectRead(*cached, "big", i * kBlock, 10);
    f.expectRead(*cached, "pack", 0, 10);  // always in use
    EXPECT_LE(cached->cache().usedBytes(), f.options.bytes);
  }
  f.far->reads = 0;
  f.expectRead(*cached, "pack", 0, 10);
  f.expectRead(*cached, "big", 199 * kBlock, 10);
  EXPECT_EQ(f.far->reads, 0);
  f.expectRead(*cached, "pack", kBlock, 10);  // gone long ago
  f.expectRead(*cached, "big", 0, 10);
  EXPECT_EQ(f.far->reads, 2);
}

TEST(RangeCache, theFileStaysBounded) {
  const TemporaryDirectory directory;
  Fixture f(std::uint64_t{4} << 20);
  f.far->objects["big"] = sample(std::size_t{48} << 20);
  const auto cached = f.open(directory.path());
  for (int round = 0; round < 4; ++round)
    for (std::uint64_t at = 0; at < (48U << 20); at += 1 << 20) f.expectRead(*cached, "big", at, 1 << 20);
  const auto size = std::filesystem::file_size(directory / "lumigrid-cache/data.mdb");
  EXPECT_LE(size, f.options.bytes * 5 / 4 + (64U << 20));
  EXPECT_LE(size, 4 * f.options.bytes);        // freed pages are used again
  f.expectRead(*cached, "big", 0, 48U << 20);  // more than the budget at once: not kept, but read
  EXPECT_TRUE(f.warnings.empty());
}

TEST(RangeCache, aSmallerBudgetHoldsFromTheNextOpening) {
  const TemporaryDirectory directory;
  Fixture f;
  f.expectRead(*f.open(directory.path()), "pack", 0, 10 * kBlock);
  f.options.bytes = 4 * (kBlock + 200);
  const auto cached = f.open(directory.path());
  EXPECT_LE(cached->cache().usedBytes(), f.options.bytes);
  f.expectRead(*cached, "pack", 0, 10 * kBlock);
}

// --- Damage

TEST(RangeCache, aDamagedFileIsDiscarded) {
  const TemporaryDirectory directory;
  Fixture f;
  const std::string file = directory / "lumigrid-cache/data.mdb";
  for (const std::string how : {"cut", "noise", "zeros", "text"}) {
    f.expectRead(*f.open(directory.path()), "pack", 0, 10 * kBlock);
    Bytes bytes = *base::readFile(file);
    std::mt19937 random(3);
    if (how == "cut") bytes.resize(bytes.size() / 2);
    if (how == "noise")
      for (std::size_t i = 0; i < bytes.size(); i += 1 + random() % 50) bytes[i] = static_cast<std::uint8_t>(random());
    if (how == "zeros") std::fill(bytes.begin(), bytes.end(), 0);
    if (how == "text") bytes = sample(100);
    ASSERT_TRUE(base::writeFileAtomically(file, bytes));
    f.warnings.clear();
    const auto cached = f.open(directory.path());
    ASSERT_EQ(f.warnings.size(), 1U) << how;
    EXPECT_NE(f.warnings[0].find("damaged; it is begun anew"), std::string::npos);
    f.expectRead(*cached, "pack", 0, 10 * kBlock);
  }
}

TEST(RangeCache, flippedBitsAreNeverReadAndNeverCrash) {
  const TemporaryDirectory directory;
  Fixture f;
  const std::string file = directory / "lumigrid-cache/data.mdb";
  std::mt19937 random(5);
  for (int round = 0; round < 60; ++round) {
    f.expectRead(*f.open(directory.path()), "pack", 0, 10 * kBlock);
    Bytes bytes = *base::readFile(file);
    for (int i = 0; i < 8; ++i) bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    ASSERT_TRUE(base::writeFileAtomically(file, bytes));
    const auto cached = f.open(directory.path());
    f.expectRead(*cached, "pack", 0, 10 * kBlock);
    f.expectRead(*cached, "pack", 0, 10 * kBlock);
  }
}

TEST(RangeCache, aDamagedPieceIsFetchedAgainAndWarnedOfOnce) {
  const TemporaryDirectory directory;
  Fixture f;
  f.expectRead(*f.open(directory.path()), "pack", 0, 10 * kBlock);
  const std::string file = directory / "lumigrid-cache/data.mdb";
  Bytes bytes = *base::readFile(file);
  // These bytes belong to the second and the fifth block, and not to LMDB's own pages.
  const Bytes& whole = f.far->objects["pack"];
  for (const std::uint64_t block : {1U, 4U}) {
    const auto begin = whole.begin() + static_cast<std::ptrdiff_t>(block * kBlock);
    const auto at = std::search(bytes.begin(), bytes.end(), begin, begin + 1000);
    ASSERT_NE(at, bytes.end());
    at[500] ^= 1;
  }
  ASSERT_TRUE(base::writeFileAtomically(file, bytes));
  const auto cached = f.open(directory.path());
  for (int i = 0; i < 2; ++i) f.expectRead(*cached, "pack", 0, 10 * kBlock);
  EXPECT_EQ(cached->counts().blocks_fetched, 2U);
  ASSERT_EQ(f.warnings.size(), 1U);
  EXPECT_NE(f.warnings[0].find("a damaged piece"), std::string::npos);
}

// --- Processes (cache_user.cpp)

using test::WriterProcess;

TEST(RangeCache, killedProcessesLeaveASoundCacheToTheOthers) {
  const TemporaryDirectory directory;
  const std::string budget = std::to_string(8 << 20);
  const auto user = [&](int seed, const char* reads) {
    return std::make_unique<WriterProcess>(
        std::vector<std::string>{directory.path(), budget, std::to_string(seed), reads});
  };
  const auto steady = user(1000, "1500");
  for (int round = 0; round < 15; ++round) {
    const auto one = user(2 * round, "1000000");
    const auto two = user(2 * round + 1, "1000000");
    for (int i = 0; i < round % 5; ++i) EXPECT_TRUE(one->nextCommitted());
    EXPECT_TRUE(two->nextCommitted());
    one->kill();
    two->kill();
  }
  EXPECT_EQ(steady->wait(), 0);  // all of its bytes were right, and nothing was warned of
  EXPECT_EQ(user(77, "100")->wait(), 0);
}

TEST(RangeCache, aFileThatIsCutWhileItIsOpenOnlyEndsCaching) {
  for (const char* name : {"data.mdb", "lock.mdb"})
    for (const int divisor : {2, 0}) {
      const TemporaryDirectory directory;
      Fixture f;
      const auto cached = f.open(directory.path());
      const std::uint64_t size = f.far->objects["pack"].size();
      f.expectRead(*cached, "pack", 0, size / 2);
      const std::string file = directory / (std::string("lumigrid-cache/") + name);
      std::filesystem::resize_file(file, divisor == 0 ? 0 : std::filesystem::file_size(file) / 2);
      for (int again = 0; again < 2; ++again) f.expectRead(*cached, "pack", 0, size);
      EXPECT_LE(f.warnings.size(), 1U);

      const auto anew = f.open(directory.path());
      f.expectRead(*anew, "pack", 0, size);
    }
}

TEST(RangeCache, aFullDiskOnlyEndsCaching) {
  const TemporaryDirectory directory;
  WriterProcess user({directory.path(), std::to_string(64 << 20), "1", "300", std::to_string(4 << 20)});
  EXPECT_EQ(user.wait(), 0);
  WriterProcess later({directory.path(), std::to_string(64 << 20), "2", "100"});
  EXPECT_EQ(later.wait(), 0);
}

TEST(RangeCache, touchesOnlyItsOwnFolder) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(base::writeFileAtomically(directory / "data.mdb", sample(100)));
  Fixture f;
  f.expectRead(*f.open(directory.path()), "pack", 0, 10);
  EXPECT_EQ(*base::readFile(directory / "data.mdb"), sample(100));
}

TEST(RangeCache, anUnusableDirectoryIsAnError) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(base::writeFileAtomically(directory / "file", sample(1)));
  Fixture f;
  EXPECT_FALSE(CachedSource::open(f.far, directory / "file", f.options));
}

}  // namespace
}  // namespace repository
