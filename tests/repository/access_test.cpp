#include "repository/access.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <numeric>
#include <random>
#include <thread>

#include "base/file.h"
#include "repository/access_counter.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

using support::TemporaryDirectory;

AccessIdentity smallIdentity() {
  Grid grid;
  grid.spacing = 2.0F;
  grid.count = {6, 5, 4};
  grid.face_size = 64;
  base::Sha256Digest hierarchy{};
  std::iota(hierarchy.begin(), hierarchy.end(), std::uint8_t{0});
  return {grid, 20, hierarchy};
}

// These are the counts of the worked example in docs/formats/access.md.
AccessCounts workedCounts() {
  AccessCounts counts;
  counts.faces = {{{0, 0, 0, 4}, 3}, {{5, 1, 2, 4}, 300}};
  counts.groups = {{0, 2}, {7, 1}};
  counts.since = 1'700'000'000;
  counts.until = 1'700'003'600;
  return counts;
}

AccessCounts facesOnly(std::vector<std::pair<FaceKey, std::uint64_t>> faces) {
  AccessCounts counts;
  counts.faces = std::move(faces);
  return counts;
}

TEST(Access, encodeMatchesTheDocumentedExample) {
  const base::Bytes bytes = encodeAccess(smallIdentity(), workedCounts());
  ASSERT_EQ(bytes.size(), 136U + 12U);
  const base::Bytes body(bytes.begin() + 136, bytes.end());
  EXPECT_EQ(body, (base::Bytes{0x80, 0x40, 0x03, 0xff, 0xff, 0x62, 0xac, 0x02, 0x00, 0x02, 0x06, 0x01}));
  const base::Bytes front(bytes.begin(), bytes.begin() + 24);
  EXPECT_EQ(front, (base::Bytes{'L',  'G',  'A',  'C',  2,  0, 136, 0, 0x77, 0xc6, 0x12, 0x5c,
                                0xa1, 0x84, 0x2a, 0x39, 12, 0, 0,   0, 0,    0,    0,    0}));
}

TEST(Access, decodeInvertsEncode) {
  std::mt19937_64 random(4);
  AccessCounts counts = workedCounts();
  counts.faces.clear();
  const Grid grid = smallIdentity().grid;
  for (const glm::uvec3& p : pointsInMortonOrder(grid))
    for (std::uint32_t d = 0; d < 6; ++d)
      if (random() % 2 == 0) counts.faces.push_back({{p.x, p.y, p.z, d}, 1 + (random() >> random() % 64)});
  const auto file = decodeAccess(encodeAccess(smallIdentity(), counts));
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->counts, counts);
  EXPECT_EQ(file->identity, smallIdentity());
}

TEST(Access, decodeRefusesEveryCutAndFlippedByte) {
  const base::Bytes good = encodeAccess(smallIdentity(), workedCounts());
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_FALSE(decodeAccess(base::ByteView(good).first(length))) << length;
  for (std::size_t at = 0; at < good.size(); ++at) {
    base::Bytes bytes = good;
    bytes[at] ^= 0x20;
    EXPECT_FALSE(decodeAccess(bytes)) << at;
  }
  base::Bytes longer = good;
  longer.push_back(0);
  EXPECT_FALSE(decodeAccess(longer));
}

TEST(Access, sumsCommuteAndSaturate) {
  const AccessCounts a = workedCounts();
  AccessCounts b = workedCounts();
  b.faces = {{{1, 0, 0, 0}, 5}, {{5, 1, 2, 4}, ~std::uint64_t{0}}};
  b.groups = {{7, 4}, {9, 1}};
  b.uncounted = 6;
  b.since = 1'600'000'000;
  const AccessCounts sum = addCounts(a, b);
  EXPECT_EQ(sum, addCounts(b, a));
  EXPECT_EQ(sum.faces, (std::vector<std::pair<FaceKey, std::uint64_t>>{
                           {{0, 0, 0, 4}, 3}, {{1, 0, 0, 0}, 5}, {{5, 1, 2, 4}, ~std::uint64_t{0}}}));
  EXPECT_EQ(sum.groups, (std::vector<std::pair<std::uint32_t, std::uint64_t>>{{0, 2}, {7, 5}, {9, 1}}));
  EXPECT_EQ(sum.uncounted, 6U);
  EXPECT_EQ(sum.since, 1'600'000'000);
  EXPECT_EQ(sum.until, a.until);
  EXPECT_EQ(addCounts(a, {}), a);
}

// ---- the file ----

TEST(AccessFile, addingToTheFileEqualsAddingInMemory) {
  const TemporaryDirectory directory;
  const std::string path = directory / "access.lga";
  std::mt19937 random(12);
  const auto points = pointsInMortonOrder(smallIdentity().grid);
  AccessCounts expected;
  for (int round = 0; round < 20; ++round) {
    AccessCounts more = workedCounts();
    more.faces.clear();
    more.until += round;
    for (const glm::uvec3& p : points)
      if (random() % 7 == 0)
        more.faces.push_back({{p.x, p.y, p.z, static_cast<std::uint32_t>(random() % 6)}, 1 + random() % 1000});
    ASSERT_TRUE(addToAccessFile(path, smallIdentity(), more, 1.0));
    expected = addCounts(expected, more);
    const auto loaded = loadAccess({path}, smallIdentity());
    ASSERT_TRUE(loaded) << loaded.error().message;
    ASSERT_EQ(*loaded, expected);
  }
}

TEST(AccessFile, manyWritersLoseAndDoubleNoCount) {
  const TemporaryDirectory directory;
  const std::string path = directory / "access.lga";
  constexpr int kWriters = 4, kRounds = 25;
  std::vector<std::thread> writers;
  for (int writer = 0; writer < kWriters; ++writer)
    writers.emplace_back([&] {
      for (int round = 0; round < kRounds; ++round)
        EXPECT_TRUE(addToAccessFile(path, smallIdentity(), workedCounts(), 60.0));
    });
  for (std::thread& writer : writers) writer.join();
  const auto loaded = loadAccess({path}, smallIdentity());
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->facesSent(), std::uint64_t{kWriters} * kRounds * 303);
  EXPECT_EQ(loaded->groupsSent(), std::uint64_t{kWriters} * kRounds * 3);
}

TEST(AccessFile, loadAddsUpSeveralFiles) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(addToAccessFile(directory / "a", smallIdentity(), workedCounts(), 1.0));
  ASSERT_TRUE(addToAccessFile(directory / "b", smallIdentity(), workedCounts(), 1.0));
  const auto loaded = loadAccess({directory / "a", directory / "b"}, smallIdentity());
  ASSERT_TRUE(loaded);
  EXPECT_EQ(loaded->facesSent(), 606U);
  const auto missing = loadAccess({directory / "a", directory / "c"}, smallIdentity());
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, base::ErrorCode::kNotFound);
}

// Only the hierarchy tells a scene from the one that it replaced: grid and groups are the same.
AccessIdentity replacedIdentity() {
  AccessIdentity identity = smallIdentity();
  identity.hierarchy.fill(0xab);
  return identity;
}

TEST(AccessFile, countsOfAReplacedSceneAreKeptApart) {
  const TemporaryDirectory directory;
  const std::string path = accessFileOf(directory.path());
  const std::string beside = directory / "access-0001020304050607.lga";
  EXPECT_EQ(accessFileBeside(path, smallIdentity().hierarchy), beside);
  EXPECT_EQ(accessFileBeside("counts", smallIdentity().hierarchy), "counts-0001020304050607");
  EXPECT_TRUE(loadSceneAccess(directory.path(), smallIdentity().hierarchy)->empty());

  // A server that holds the replaced scene writes first, and again between the counts of the new one.
  const AccessCounts of_old = facesOnly({{{0, 0, 0, 0}, 1}});
  for (int round = 1; round <= 2; ++round) {
    const auto old_place = addToAccessFile(path, replacedIdentity(), of_old, 1.0);
    ASSERT_TRUE(old_place) << old_place.error().message;
    EXPECT_EQ(*old_place, path);
    EXPECT_EQ(bool(loadSceneAccess(directory.path(), smallIdentity().hierarchy)), round == 2);
    const auto new_place = addToAccessFile(path, smallIdentity(), workedCounts(), 1.0);
    ASSERT_TRUE(new_place) << new_place.error().message;
    EXPECT_EQ(*new_place, beside);
  }
  const auto files = loadSceneAccess(directory.path(), smallIdentity().hierarchy);
  ASSERT_TRUE(files);
  ASSERT_EQ(files->size(), 1U);
  EXPECT_EQ(files->front().identity, smallIdentity());
  EXPECT_EQ(files->front().counts.facesSent(), 606U);
  EXPECT_EQ(loadAccess({path}, replacedIdentity())->facesSent(), 2U);
  EXPECT_FALSE(loadAccess({path}, smallIdentity()));

  // When somebody took the replaced scene's counts away, those of the new one lie in both files.
  std::filesystem::remove(path);
  EXPECT_EQ(*addToAccessFile(path, smallIdentity(), workedCounts(), 1.0), path);
  EXPECT_EQ(loadSceneAccess(directory.path(), smallIdentity().hierarchy)->size(), 2U);
}

TEST(AccessFile, aFileOfAnotherVersionSaysSo) {
  base::Bytes bytes = encodeAccess(smallIdentity(), workedCounts());
  bytes[4] = 1;
  const auto earlier = decodeAccess(bytes);
  ASSERT_FALSE(earlier);
  EXPECT_EQ(earlier.error().code, base::ErrorCode::kVersion);
  EXPECT_NE(earlier.error().message.find("does not name its scene; move the file away"), std::string::npos);
  bytes[4] = 3;
  EXPECT_NE(decodeAccess(bytes).error().message.find("use a newer lumigrid"), std::string::npos);
}

TEST(AccessFile, damagedFilesStayUnchanged) {
  const TemporaryDirectory directory;
  const std::string path = directory / "access.lga";
  ASSERT_TRUE(addToAccessFile(path, smallIdentity(), workedCounts(), 1.0));
  const base::Bytes before = *base::readFile(path);

  AccessIdentity other_grid = smallIdentity();
  other_grid.grid.spacing = 3.0F;
  EXPECT_FALSE(loadAccess({path}, other_grid));
  ASSERT_TRUE(addToAccessFile(path, other_grid, facesOnly({{{0, 0, 0, 0}, 1}}), 1.0));
  EXPECT_EQ(*base::readFile(path), before) << "its counts went to a file beside";

  base::Bytes damaged = before;
  damaged.back() ^= 1;
  ASSERT_TRUE(base::writeFileAtomically(path, damaged));
  const auto refused = addToAccessFile(path, smallIdentity(), workedCounts(), 1.0);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find(path), std::string::npos);
  EXPECT_NE(refused.error().message.find("move the file away"), std::string::npos) << refused.error().message;
  EXPECT_EQ(*base::readFile(path), damaged);
}

TEST(AccessFile, leftoversOfAKilledWriterAreRemoved) {
  const TemporaryDirectory directory;
  const std::string path = directory / "access.lga";
  std::ofstream(path + ".part1234") << "half";
  ASSERT_TRUE(addToAccessFile(path, smallIdentity(), workedCounts(), 1.0));
  EXPECT_FALSE(std::filesystem::exists(path + ".part1234"));
  EXPECT_EQ(loadAccess({path}, smallIdentity())->facesSent(), 303U);
}

TEST(AccessFile, aMissingDirectoryIsAnErrorThatNamesTheFile) {
  const TemporaryDirectory directory;
  const auto refused = addToAccessFile(directory / "nowhere/access.lga", smallIdentity(), {}, 1.0);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("nowhere/access.lga"), std::string::npos);
}

// ---- the counter ----

TEST(AccessCounter, countsFromSeveralThreadsAddUp) {
  AccessCounter counter;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] {
      for (std::uint32_t n = 0; n < 6000; ++n) {
        counter.addFace({n % 6, n % 5, n % 4, n % 6});
        counter.addGroup(n % 20);
      }
    });
  for (std::thread& thread : threads) thread.join();
  const AccessCounts counts = counter.takeCounts();
  EXPECT_EQ(counts.facesSent(), 24'000U);
  EXPECT_EQ(counts.groups.size(), 20U);
  EXPECT_EQ(counts.groupsSent(), 24'000U);
  EXPECT_TRUE(decodeAccess(encodeAccess(smallIdentity(), counts))) << "in order";
  EXPECT_EQ(counter.takeCounts(), AccessCounts{});
}

TEST(AccessCounter, keysBeyondTheLimitAreCountedTogether) {
  int calls = 0;
  AccessCounter counter(3, [&] { ++calls; });
  for (std::uint32_t n = 0; n < 6; ++n) {
    counter.addFace({n % 6, 0, 0, 0});
    counter.addFace({0, 0, 0, 0});
  }
  EXPECT_EQ(calls, 1);
  const AccessCounts counts = counter.takeCounts();
  EXPECT_EQ(counts.faces.size(), 3U);
  EXPECT_EQ(counts.facesSent(), 9U);
  EXPECT_EQ(counts.uncounted, 3U);
  for (std::uint32_t n = 0; n < 4; ++n) counter.addGroup(n);
  EXPECT_EQ(calls, 2) << "takeCounts arms it again";
}

// ---- ranking ----

TEST(AccessRank, rankPointsAddsUpThePointsFaces) {
  const AccessCounts counts = facesOnly({{{0, 0, 0, 1}, 2}, {{0, 0, 0, 5}, 3}, {{1, 0, 0, 0}, 9}, {{2, 1, 0, 0}, 5}});
  const auto points = rankPoints(counts);
  ASSERT_EQ(points.size(), 3U);
  EXPECT_EQ(points[0].point, glm::uvec3(1, 0, 0));
  EXPECT_EQ(points[1].point, glm::uvec3(0, 0, 0)) << "5 as well, and before in Morton order";
  EXPECT_EQ(points[1].sent, 5U);
}

}  // namespace
}  // namespace repository
