#include "repository/objects/mirror.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

using base::Bytes;
using base::ErrorCode;
using support::TemporaryDirectory;

// A source that counts the bytes it returned and can fail after a number of reads.
class Source final : public ObjectSource {
 public:
  explicit Source(Bytes bytes) : bytes_(std::move(bytes)) {}
  base::Result<Bytes> read(const std::string&, std::uint64_t offset, std::uint64_t length) const override {
    if (reads_left == 0) return base::Error{ErrorCode::kNetwork, "gone"};
    --reads_left;
    given += length;
    const auto begin = bytes_.begin() + static_cast<std::ptrdiff_t>(offset);
    return Bytes(begin, begin + static_cast<std::ptrdiff_t>(length));
  }
  base::Result<std::uint64_t> size(const std::string&) const override { return bytes_.size(); }
  const std::string& place() const override { return place_; }

  mutable std::atomic<int> reads_left{1000000};
  mutable std::atomic<std::uint64_t> given{0};

 private:
  Bytes bytes_;
  std::string place_ = "far://scene";
};

Bytes sample(std::size_t size) {
  Bytes bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(i * 7 + i / 251);
  return bytes;
}

std::size_t filesIn(const std::string& path) {
  return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(path), {}));
}

TEST(Mirror, theFileEqualsTheObjectAndIsFetchedOnce) {
  const TemporaryDirectory directory;
  const Bytes bytes = sample(1000);
  const Source source(bytes);
  for (int i = 0; i < 2; ++i) {
    const auto path =
        mirrorObject(source, "a/patch.lgp", directory.path(), base::hexOf(base::sha256(bytes)), {100, {}});
    ASSERT_TRUE(path) << path.error().message;
    EXPECT_EQ(*path, directory / "a/patch.lgp");
    EXPECT_EQ(*base::readFile(*path), bytes);
  }
  EXPECT_EQ(source.given, 1000U);
  EXPECT_EQ(filesIn(directory / "a"), 1U);
}

TEST(Mirror, resumesWhereItWasStopped) {
  const TemporaryDirectory directory;
  const Bytes bytes = sample(1000);
  const Source source(bytes);
  const std::string hash = base::hexOf(base::sha256(bytes));
  source.reads_left = 3;
  EXPECT_EQ(mirrorObject(source, "p", directory.path(), hash, {100, {}}).error().code, ErrorCode::kNetwork);
  EXPECT_FALSE(std::filesystem::exists(directory / "p"));
  source.reads_left = 1000;
  std::uint64_t calls = 0;
  const auto stop = [&](std::uint64_t done, std::uint64_t total) {
    EXPECT_EQ(total, 1000U);
    ++calls;
    return done < 600;
  };
  EXPECT_EQ(mirrorObject(source, "p", directory.path(), hash, {100, stop}).error().code, ErrorCode::kCancelled);
  EXPECT_EQ(calls, 3U);
  ASSERT_TRUE(mirrorObject(source, "p", directory.path(), hash, {100, {}}));
  EXPECT_EQ(source.given, 1000U);
  EXPECT_EQ(*base::readFile(directory / "p"), bytes);
}

TEST(Mirror, aDamagedPartIsFetchedAgain) {
  const TemporaryDirectory directory;
  const Bytes bytes = sample(1000);
  const std::string hash = base::hexOf(base::sha256(bytes));
  const std::string partial = directory / ("p.partial-" + hash.substr(0, 16));
  for (const std::size_t kept : {300U, 1000U, 2000U}) {
    const Source source(bytes);
    ASSERT_TRUE(base::writeFileAtomically(partial, Bytes(kept, 0)));
    ASSERT_TRUE(mirrorObject(source, "p", directory.path(), hash, {100, {}}));
    EXPECT_EQ(*base::readFile(directory / "p"), bytes);
    std::filesystem::remove(directory / "p");
  }
}

TEST(Mirror, anotherVersionReplacesTheFile) {
  const TemporaryDirectory directory;
  const Bytes old = sample(500);
  const Bytes bytes = sample(1000);
  ASSERT_TRUE(mirrorObject(Source(old), "p", directory.path(), base::hexOf(base::sha256(old)), {}));
  ASSERT_TRUE(mirrorObject(Source(bytes), "p", directory.path(), base::hexOf(base::sha256(bytes)), {}));
  EXPECT_EQ(*base::readFile(directory / "p"), bytes);
}

TEST(Mirror, anObjectWithAnotherDigestIsRefused) {
  const TemporaryDirectory directory;
  const auto path = mirrorObject(Source(sample(1000)), "p", directory.path(), std::string(64, 'a'), {});
  ASSERT_FALSE(path);
  EXPECT_EQ(path.error().code, ErrorCode::kInvalidInput);
  EXPECT_NE(path.error().message.find("far://scene/p: its SHA-256 is "), std::string::npos) << path.error().message;
  EXPECT_EQ(filesIn(directory.path()), 0U);
  for (const std::string& wrong : {std::string(), std::string(64, 'A'), std::string(63, 'a')})
    EXPECT_EQ(mirrorObject(Source(sample(1)), "p", directory.path(), wrong, {}).error().code, ErrorCode::kInvalidInput);
  EXPECT_EQ(mirrorObject(Source(sample(1)), "../p", directory.path(), std::string(64, 'a'), {}).error().code,
            ErrorCode::kInvalidInput);
}

TEST(Mirror, anEmptyObjectIsAFileToo) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(mirrorObject(Source({}), "p", directory.path(), base::hexOf(base::sha256({})), {}));
  EXPECT_TRUE(base::readFile(directory / "p")->empty());
}

TEST(Mirror, oneOfSeveralCallersDownloads) {
  const TemporaryDirectory directory;
  const Bytes bytes = sample(100000);
  const Source source(bytes);
  std::vector<std::thread> threads;
  for (int t = 0; t < 6; ++t)
    threads.emplace_back([&] {
      const auto path = mirrorObject(source, "p", directory.path(), base::hexOf(base::sha256(bytes)), {1000, {}});
      EXPECT_TRUE(path);
      EXPECT_EQ(*base::readFile(directory / "p"), bytes);
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(source.given, 100000U);
  EXPECT_EQ(filesIn(directory.path()), 1U);
}

}  // namespace
}  // namespace repository
