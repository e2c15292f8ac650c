// Publishes a store as packs and reads it back.
#include "repository/packs/publish.h"

#include <gtest/gtest.h>
#include <sys/mount.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <map>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "base/parallel.h"
#include "repository/packs/pack_store.h"
#include "repository/verify.h"
#include "tests/repository/sample_values.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

namespace fs = std::filesystem;
using base::Bytes;
using base::ByteView;
using base::ErrorCode;
using base::Result;

// Counts the reads of each object.
class CountingSource final : public ObjectSource {
 public:
  explicit CountingSource(std::unique_ptr<ObjectSource> source) : source_(std::move(source)) {}
  Result<Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override {
    ++reads;
    bytes += length;
    return source_->read(name, offset, length);
  }
  Result<std::uint64_t> size(const std::string& name) const override {
    ++reads;
    return source_->size(name);
  }
  const std::string& place() const override { return source_->place(); }
  mutable std::atomic<std::uint64_t> reads{0}, bytes{0};

 private:
  std::unique_ptr<ObjectSource> source_;
};

// Fails at the n-th put like a full disk.
class FailingSink final : public ObjectSink {
 public:
  FailingSink(std::unique_ptr<ObjectSink> sink, int puts) : sink_(std::move(sink)), left_(puts) {}
  Result<void> put(const std::string& name, ByteView bytes, const std::string& type) override {
    if (left_-- <= 0) return base::Error{ErrorCode::kNoSpace, place() + "/" + name + ": no space"};
    return sink_->put(name, bytes, type);
  }
  Result<void> putFile(const std::string& name, const std::string& path, const std::string& type) override {
    return sink_->putFile(name, path, type);
  }
  Result<std::optional<std::uint64_t>> size(const std::string& name) override { return sink_->size(name); }
  Result<std::vector<std::string>> list(const std::string& prefix) override { return sink_->list(prefix); }
  Result<void> remove(const std::string& name) override { return sink_->remove(name); }
  const std::string& place() const override { return sink_->place(); }

 private:
  std::unique_ptr<ObjectSink> sink_;
  std::atomic<int> left_;
};

// Mounts a disk of 8 MB in memory; the destructor unmounts it.
class SmallDisk {
 public:
  explicit SmallDisk(const std::string& path) : path_(path) {
    fs::create_directories(path);
    mounted_ = ::mount("none", path.c_str(), "tmpfs", 0, "size=8m") == 0;
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  ~SmallDisk() {
    if (mounted_) ::umount2(path_.c_str(), MNT_DETACH);
  }
  bool mounted() const { return mounted_; }
  bool grow() const { return ::mount("none", path_.c_str(), "tmpfs", MS_REMOUNT, "size=64m") == 0; }

 private:
  std::string path_;
  bool mounted_ = false;
};

constexpr std::uint32_t kSide = 12;

// The store has 12 × 12 × 12 points with 10,368 faces of about 1 kB to 4 kB, every seventh of them empty: 22 MB in
// packs of a MiB.
class Publish : public testing::Test {
 protected:
  Publish() {
    store_ = std::move(*openLmdbStore(directory_ / "images", StoreMode::kWrite));
    std::vector<std::pair<FaceKey, Bytes>> batch;
    for (std::uint32_t i = 0; i < kSide * kSide * kSide * 6; ++i) batch.emplace_back(keyOf(i), valueOf(i));
    EXPECT_TRUE(store_->putBatch(batch));
    EXPECT_TRUE(store_->writeMeta("{\"some\": 1}"));
    options_.pack_bytes = kMinPackTarget;
  }
  static FaceKey keyOf(std::uint32_t number) {
    const std::uint32_t point = number / 6;
    return {point % kSide, point / kSide % kSide, point / kSide / kSide, number % 6};
  }
  static Bytes valueOf(std::uint32_t number, std::uint8_t seed = 0) {
    if (number % 7 == 3) return encodeFaceValue({});
    const Bytes jpeg(1000 + number * 7919U % 3000U, static_cast<std::uint8_t>(number + seed));
    return encodeFaceValue({false, jpeg, {}});
  }
  PublishedImages publish() {
    auto sink = openDirectorySink(out());
    auto published = publishImages(*store_, **sink, options_);
    EXPECT_TRUE(published) << published.error().message;
    return *published;
  }
  std::string out() const { return directory_ / "out"; }
  std::unique_ptr<PackStore> open(const std::string& index) {
    source_ = std::make_shared<CountingSource>(*openDirectorySource(out()));
    auto store = PackStore::open(source_, index);
    EXPECT_TRUE(store) << store.error().message;
    return std::move(*store);
  }
  std::vector<std::string> faults(const PackStore& packs, std::uint64_t* values = nullptr) {
    std::vector<std::string> found;
    packs.check([&](std::string fault) { return found.push_back(std::move(fault)), true; },
                [&](const FaceKey&, ByteView) {
                  if (values != nullptr) ++*values;
                  return true;
                });
    return found;
  }
  void flip(const std::string& name, std::uint64_t offset) {
    std::fstream file(out() + "/" + name, std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(static_cast<std::streamoff>(offset));
    const char byte = static_cast<char>(file.get() ^ 0x20);
    file.seekp(static_cast<std::streamoff>(offset));
    file.put(byte);
  }
  // Counts the store's faces that the published one returns. Every other one must give an error that names `piece`.
  std::uint64_t served(const PackStore& packs, const std::string& piece) {
    std::uint64_t good = 0;
    EXPECT_TRUE(store_->forEach([&](const FaceKey& key, ByteView value) {
      const auto got = packs.get(key);
      if (got) {
        EXPECT_TRUE(got->has_value());
        EXPECT_TRUE(std::equal(value.begin(), value.end(), (*got)->begin(), (*got)->end()));
        ++good;
      } else {
        EXPECT_NE(got.error().message.find(piece), std::string::npos) << got.error().message;
      }
      return true;
    }));
    return good;
  }

  support::TemporaryDirectory directory_;
  std::unique_ptr<Store> store_;
  PublishOptions options_;
  std::shared_ptr<CountingSource> source_;
};

TEST_F(Publish, everyWayOfReadingReturnsEveryValue) {
  const PublishedImages published = publish();
  EXPECT_EQ(published.keys, 10368U);
  EXPECT_GT(published.pack_names.size(), 20U);
  EXPECT_EQ(published.packs_written, published.pack_names.size());
  const auto packs = open(published.index);
  EXPECT_EQ(*packs->size(), 10368U);
  EXPECT_EQ(*packs->readMeta(), std::optional<std::string>("{\"some\": 1}"));
  EXPECT_EQ(packs->root().empty, published.empty);
  EXPECT_EQ(served(*packs, "no error is allowed"), 10368U);

  std::vector<std::pair<FaceKey, Bytes>> theirs;
  std::vector<std::pair<FaceKey, Bytes>> ours;
  const auto takeInto = [](auto& list) {
    return [&list](const FaceKey& key, ByteView value) {
      list.emplace_back(key, Bytes(value.begin(), value.end()));
      return true;
    };
  };
  ASSERT_TRUE(store_->forEach(takeInto(theirs)));
  ASSERT_TRUE(packs->forEach(takeInto(ours)));
  EXPECT_TRUE(theirs == ours);

  std::vector<FaceKey> keys;
  for (const auto& [key, value] : theirs) keys.push_back(key);
  keys.push_back({kSide, 0, 0, 0});
  const auto many = packs->getMany(keys);
  ASSERT_EQ(many.size(), keys.size());
  for (std::size_t i = 0; i < theirs.size(); ++i) {
    ASSERT_TRUE(many[i]) << many[i].error().message;
    ASSERT_TRUE(*many[i] == theirs[i].second) << i;
  }
  ASSERT_TRUE(many.back());
  EXPECT_EQ(*many.back(), std::nullopt);
  EXPECT_FALSE(*packs->contains({kSide, 0, 0, 0}));
  EXPECT_TRUE(*packs->contains({kSide - 1, 0, 0, 0}));
  EXPECT_TRUE(faults(*packs).empty());
  const auto a = contentsOf(*store_);
  const auto b = contentsOf(*packs);
  EXPECT_EQ(a->jpeg_bytes, b->jpeg_bytes);
  EXPECT_EQ(a->jpeg_bytes, packs->root().totals.jpeg_bytes);
}

TEST_F(Publish, publishedImagesCannotBeWritten) {
  const auto packs = open(publish().index);
  EXPECT_EQ(packs->putBatch({}).error().code, ErrorCode::kUnsupported);
  EXPECT_EQ(packs->erase({}).error().code, ErrorCode::kUnsupported);
  EXPECT_EQ(packs->writeMeta("").error().code, ErrorCode::kUnsupported);
}

TEST_F(Publish, aLongFrontIsReadWhole) {
  const std::string parameters = "{\"some\": \"" + std::string(2 * kIndexFrontBytes, 'p') + "\"}";
  ASSERT_TRUE(store_->writeMeta(parameters));
  const PublishedImages published = publish();
  const auto packs = open(published.index);
  EXPECT_EQ(*packs->readMeta(), parameters);
  EXPECT_EQ(published.index_front_bytes, packs->root().frontBytes());
  EXPECT_EQ(packs->root().fill.size(), packs->root().blocks);
}

TEST_F(Publish, aFaceTakesAtMostTwoReads) {
  const auto packs = open(publish().index);
  EXPECT_EQ(source_->reads, 1U);
  EXPECT_EQ(source_->bytes, kIndexFrontBytes);
  ASSERT_TRUE(packs->get({5, 6, 7, 0}));
  EXPECT_EQ(source_->reads, 3U);
  ASSERT_TRUE(packs->get({5, 6, 7, 1}));
  EXPECT_EQ(source_->reads, 4U) << "its neighbour's block is cached";
  source_->reads = 0;
  std::uint32_t empty = 0;
  while (valueOf(empty).size() != 8) ++empty;
  EXPECT_EQ(*packs->valueBytes(keyOf(empty)), 8U);
  source_->reads = 0;
  EXPECT_EQ(*packs->get(keyOf(empty)), encodeFaceValue({}));
  EXPECT_EQ(source_->reads, 0U) << "an empty flag is in the index";
}

TEST_F(Publish, aNeighbourhoodTakesFewReads) {
  const auto packs = open(publish().index);
  std::vector<FaceKey> keys;  // all faces of an aligned cell's eight corners
  for (std::uint32_t i = 0; i < 8; ++i)
    for (std::uint32_t d = 0; d < 6; ++d) keys.push_back({4 + (i & 1), 4 + (i >> 1 & 1), 4 + (i >> 2), d});
  source_->reads = 0;
  for (const auto& value : packs->getMany(keys)) EXPECT_TRUE(value && value->has_value());
  EXPECT_LE(source_->reads, 2U);
}

TEST_F(Publish, threadsReadSideBySideThroughASmallCache) {
  const PublishedImages published = publish();
  PackStoreOptions options;
  options.block_cache_bytes = 1;
  options.jobs = 4;
  const auto packs = PackStore::open(*openDirectorySource(out()), published.index, options);
  ASSERT_TRUE(packs);
  std::vector<std::vector<FaceKey>> keys(4);
  for (std::uint32_t i = 0; i < 2000; ++i) keys[i % 4].push_back(keyOf(i * 5));
  base::parallelFor(4, 4, [&](std::size_t thread) {
    const auto values = (*packs)->getMany(keys[thread]);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const auto one = (*packs)->get(keys[thread][i]);
      EXPECT_TRUE(one && values[i] && *one == *values[i]);
      EXPECT_EQ(*one, valueOf(static_cast<std::uint32_t>((4 * i + thread) * 5)));
    }
  });
}

TEST_F(Publish, anIndexWhoseValuesOverlapIsReadWithinItsRanges) {
  // Two packs have the same id, so their values claim the same bytes; those of the second are longer.
  auto sink = openDirectorySink(out());
  const Bytes value = valueOf(1);
  const ObjectId id{9};
  const std::vector<PackEntry> some{{0, static_cast<std::uint32_t>(value.size())}};
  const std::vector<PackEntry> other{{512, 8}, {513, 8}};
  ASSERT_TRUE((*sink)->put(packName(id), encodePack(some, value), ""));
  IndexBuilder builder;
  builder.addPack(some);
  builder.addPack(other);
  ASSERT_TRUE((*sink)->put(indexName(id), *builder.build({{id, 5000, 0, 0, 1}, {id, 5000, 512, 513, 2}}, "", {}), ""));
  const auto packs = open(indexName(id));
  const auto values = packs->getMany({*FaceKey::fromCode(512), *FaceKey::fromCode(0), *FaceKey::fromCode(513)});
  EXPECT_FALSE(values[0]);
  ASSERT_TRUE(values[1]) << values[1].error().message;
  EXPECT_EQ(*values[1], value);
  EXPECT_FALSE(values[2]);
}

TEST_F(Publish, theSameStoreMakesTheSameBytesAndWritesNothingTwice) {
  const PublishedImages first = publish();
  const PublishedImages again = publish();
  EXPECT_EQ(again.index, first.index);
  EXPECT_EQ(again.pack_names, first.pack_names);
  EXPECT_EQ(again.bytes_written, 0U);
  options_.jobs = 1;
  options_.rewrite = true;
  const PublishedImages rewritten = publish();
  EXPECT_EQ(rewritten.index, first.index);
  EXPECT_EQ(rewritten.packs_written, first.pack_names.size());
}

TEST_F(Publish, packsKeepToTheirSizeAndSmallScenesHaveOne) {
  const PublishedImages published = publish();
  for (std::size_t i = 0; i < published.pack_names.size(); ++i) {
    const auto bytes = fs::file_size(out() + "/" + published.pack_names[i]);
    EXPECT_LE(bytes, kMinPackTarget) << i;
    EXPECT_TRUE(i + 1 == published.pack_names.size() || bytes >= kMinPackTarget / 2 - 8192) << i << ": " << bytes;
  }
  options_.pack_bytes = kMaxPackTarget;
  EXPECT_EQ(publish().pack_names.size(), 1U);
}

TEST_F(Publish, aChangedValueAndANewOneChangeFewPacks) {
  const PublishedImages first = publish();
  ASSERT_TRUE(store_->putBatch({{keyOf(1201), valueOf(1201, 77)}}));
  EXPECT_EQ(publish().packs_written, 1U);
  ASSERT_TRUE(store_->erase({keyOf(5000), keyOf(5001)}));
  ASSERT_TRUE(store_->putBatch({{{20, 20, 20, 0}, valueOf(1)}}));
  const PublishedImages third = publish();
  EXPECT_LE(third.packs_written, first.pack_names.size() / 3);
  // The first version is still there and whole.
  EXPECT_TRUE(faults(*open(first.index)).empty());
  EXPECT_TRUE(faults(*open(third.index)).empty());
}

TEST_F(Publish, aFailureAtAnyPutIsNamedAndTheRerunWritesTheRest) {
  const std::uint64_t objects = publish().pack_names.size() + 1;
  for (const int puts : {0, 1, 7, static_cast<int>(objects) - 1}) {
    fs::remove_all(out());
    FailingSink sink(*openDirectorySink(out()), puts);
    const auto failed = publishImages(*store_, sink, options_);
    ASSERT_FALSE(failed) << puts;
    EXPECT_EQ(failed.error().code, ErrorCode::kNoSpace);
    const auto there = sink.list("")->size();
    EXPECT_EQ(there, static_cast<std::size_t>(puts));
  }
  const PublishedImages rest = publish();  // all packs were there, the index was not
  EXPECT_EQ(rest.packs_written, 0U);
  EXPECT_EQ(rest.bytes_written, rest.index_bytes);
  EXPECT_TRUE(faults(*open(rest.index)).empty());
}

TEST_F(Publish, aFullDiskIsNamedAndTheRerunFinishes) {
  const SmallDisk disk(out());
  if (!disk.mounted()) GTEST_SKIP() << "this user may not mount a small disk";
  {
    auto sink = openDirectorySink(out());
    const auto full = publishImages(*store_, **sink, options_);
    ASSERT_FALSE(full);
    EXPECT_EQ(full.error().code, ErrorCode::kNoSpace) << full.error().message;
    EXPECT_NE(full.error().message.find("run the same command again"), std::string::npos) << full.error().message;
    EXPECT_TRUE(idOfPackName((*sink)->list("")->back())) << "nothing half-written stays";
  }
  ASSERT_TRUE(disk.grow());
  const PublishedImages published = publish();
  EXPECT_LT(published.packs_written, published.pack_names.size());
  EXPECT_TRUE(faults(*open(published.index)).empty());
}

TEST_F(Publish, stopsWhenAsked) {
  auto sink = openDirectorySink(out());
  int asked = 0;
  const auto stopped = publishImages(*store_, **sink, options_, [&](const PublishProgress& progress) {
    EXPECT_EQ(progress.keys_total, 10368U);
    return ++asked < 4;
  });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::kCancelled);
  EXPECT_LT((*sink)->list("")->size(), 8U);
}

TEST_F(Publish, aDamagedValueIsNotPublished) {
  Bytes value = valueOf(1);
  value[50] ^= 1U;
  ASSERT_TRUE(store_->putBatch({{{1, 2, 3, 4}, value}}));
  auto sink = openDirectorySink(out());
  const auto refused = publishImages(*store_, **sink, options_);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("face (1, 2, 3, 4): face value: checksum differs"), std::string::npos)
      << refused.error().message;
}

TEST_F(Publish, anEmptyRepositoryAndOneOfEmptyFlagsCanBePublished) {
  std::vector<FaceKey> all;
  for (std::uint32_t i = 0; i < kSide * kSide * kSide * 6; ++i) all.push_back(keyOf(i));
  ASSERT_TRUE(store_->erase(all));
  const PublishedImages nothing = publish();
  EXPECT_TRUE(nothing.pack_names.empty());
  const auto none = open(nothing.index);
  EXPECT_EQ(*none->get({0, 0, 0, 0}), std::nullopt);
  EXPECT_TRUE(faults(*none).empty());

  std::vector<std::pair<FaceKey, Bytes>> flags;
  for (const FaceKey& key : all) flags.emplace_back(key, encodeFaceValue({}));
  ASSERT_TRUE(store_->putBatch(flags));
  const PublishedImages empties = publish();
  EXPECT_EQ(empties.empty, 10368U);
  EXPECT_LE(empties.pack_bytes, 2 * empties.empty) << "a flag costs a byte and a share of its run";
  const auto packs = open(empties.index);
  EXPECT_EQ(served(*packs, "none"), 10368U);
  EXPECT_TRUE(faults(*packs).empty());
}

// --- Damage. Errors name it, and all other faces are still served.

TEST_F(Publish, aMissingPackIsNamedAndTheOthersAreServed) {
  const PublishedImages published = publish();
  const auto packs = open(published.index);
  const std::string lost = published.pack_names[3];
  fs::remove(out() + "/" + lost);
  const std::uint64_t good = served(*packs, lost);
  EXPECT_LT(good, 10368U);
  EXPECT_GT(good, 9000U);
  std::uint64_t values = 0;
  const auto found = faults(*packs, &values);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NE(found[0].find(lost), std::string::npos) << found[0];
  EXPECT_GT(values, 9000U);
  EXPECT_EQ(packs->forEach([](const FaceKey&, ByteView) { return true; }).error().code, ErrorCode::kNotFound);
}

TEST_F(Publish, aTruncatedPackServesWhatIsLeftOfIt) {
  const PublishedImages published = publish();
  const auto packs = open(published.index);
  const std::string path = out() + "/" + published.pack_names[2];
  std::uint64_t in_pack = 0;
  const auto rows = packs->readPackRows();
  for (const PackRow& row : *rows)
    if (packName(row.id) == published.pack_names[2]) in_pack = row.keys;
  fs::resize_file(path, fs::file_size(path) / 2);
  const std::uint64_t good = served(*packs, published.pack_names[2]);
  EXPECT_LT(good, 10368U);
  EXPECT_GT(good, 10368U - in_pack + in_pack / 4);

  std::vector<FaceKey> keys;
  for (std::uint32_t i = 0; i < kSide * kSide * kSide * 6; ++i) keys.push_back(keyOf(i));
  std::uint64_t together = 0;
  for (const auto& value : packs->getMany(keys)) together += value ? 1U : 0U;
  EXPECT_EQ(together, good);
  const auto found = faults(*packs);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NE(found[0].find("truncated"), std::string::npos) << found[0];
}

TEST_F(Publish, aFlippedByteInAValueIsThatValuesError) {
  const PublishedImages published = publish();
  const auto packs = open(published.index);
  flip(published.pack_names[1], 5000);
  std::vector<std::string> told;
  packs->setErrorListener([&](const base::Error& error) { told.push_back(error.message); });
  EXPECT_EQ(served(*packs, published.pack_names[1] + ": face ("), 10367U);
  const auto found = faults(*packs);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NE(found[0].find("SHA-256"), std::string::npos) << found[0];

  ASSERT_EQ(told.size(), 1U);
  EXPECT_NE(told[0].find(published.pack_names[1]), std::string::npos) << told[0];

  options_.rewrite = true;  // the size is right, so only this mends it
  publish();
  EXPECT_EQ(served(*packs, "none"), 10368U);
}

TEST_F(Publish, aPackOfOtherContentIsFound) {
  const PublishedImages published = publish();
  const auto packs = open(published.index);
  fs::copy_file(out() + "/" + published.pack_names[0], out() + "/" + published.pack_names[5],
                fs::copy_options::overwrite_existing);
  EXPECT_FALSE(faults(*packs).empty());
  EXPECT_LT(served(*packs, published.pack_names[5]), 10368U);
}

TEST_F(Publish, aTruncatedIndexServesTheBlocksThatAreLeft) {
  const PublishedImages published = publish();
  const std::string path = out() + "/" + published.index;
  const auto whole = open(published.index);
  ASSERT_GE(whole->root().blocks, 2U);
  fs::resize_file(path, whole->root().blockOffset(whole->root().blocks / 2) + 100);
  const auto packs = open(published.index);
  const std::uint64_t good = served(*packs, published.index);
  EXPECT_GT(good, 2000U);
  EXPECT_LT(good, 9000U);
  EXPECT_FALSE(faults(*packs).empty());

  fs::resize_file(path, 1000);
  const auto none = PackStore::open(source_, published.index);
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("truncated"), std::string::npos) << none.error().message;
}

TEST_F(Publish, aFlippedByteInTheIndexCostsOneBlock) {
  const PublishedImages published = publish();
  const std::uint64_t offset = open(published.index)->root().blockOffset(1) + 40;
  flip(published.index, offset);
  const auto packs = open(published.index);
  const std::uint64_t good = served(*packs, "block 1 of the index: its checksum differs");
  EXPECT_LT(good, 10368U);
  EXPECT_GT(good, 5000U);
  EXPECT_EQ(faults(*packs).size(), 2U) << "the block, and the index's SHA-256";
  flip(published.index, offset);
  flip(published.index, 30);
  EXPECT_EQ(PackStore::open(source_, published.index).error().code, ErrorCode::kInvalidInput);
  flip(published.index, 30);
  flip(published.index, 130);
  const auto wrong = PackStore::open(source_, published.index);
  ASSERT_FALSE(wrong);
  EXPECT_NE(wrong.error().message.find("parameters"), std::string::npos) << wrong.error().message;
}

TEST_F(Publish, aCheckStopsWhenThereAreEnoughFaults) {
  const PublishedImages published = publish();
  ASSERT_GT(published.pack_names.size(), 10U);
  for (const std::string& name : published.pack_names) fs::remove(out() + "/" + name);
  const auto packs = open(published.index);
  EXPECT_EQ(faults(*packs).size(), published.pack_names.size());
  std::size_t told = 0;
  packs->check([&](const std::string&) { return ++told < 3; }, [](const FaceKey&, ByteView) { return true; });
  EXPECT_EQ(told, 3U);
}

TEST_F(Publish, wrongTotalsAreAFault) {
  auto sink = openDirectorySink(out());
  const Bytes value = valueOf(1);
  const std::vector<PackEntry> entries{{0, static_cast<std::uint32_t>(value.size())}};
  const Bytes pack = encodePack(entries, value);
  const auto idOf = [](ByteView bytes) {
    ObjectId id{};
    const base::Sha256Digest digest = base::sha256(bytes);
    std::copy_n(digest.begin(), id.size(), id.begin());
    return id;
  };
  ASSERT_TRUE((*sink)->put(packName(idOf(pack)), pack, ""));
  IndexBuilder builder;
  builder.addPack(entries);
  const auto faultsWith = [&](const ValueTotals& totals) {
    const Bytes index = *builder.build({{idOf(pack), pack.size(), 0, 0, 1}}, "", totals);
    EXPECT_TRUE((*sink)->put(indexName(idOf(index)), index, ""));
    return faults(*open(indexName(idOf(index))));
  };
  EXPECT_EQ(faultsWith({value.size(), value.size() - 16, 0}), std::vector<std::string>());
  for (const ValueTotals& wrong :
       {ValueTotals{value.size() + 1, value.size() - 15, 0}, ValueTotals{value.size(), value.size(), 0},
        ValueTotals{value.size(), value.size() - 16, ~std::uint64_t{0}}}) {
    const auto found = faultsWith(wrong);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_NE(found[0].find("its root says " + std::to_string(wrong.value_bytes)), std::string::npos) << found[0];
  }
}

}  // namespace
}  // namespace repository
