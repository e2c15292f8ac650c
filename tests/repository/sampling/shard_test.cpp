#include "repository/sampling/shard.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "repository/sampling/expected_points.h"

namespace repository {
namespace {

Grid gridOf(std::uint32_t x, std::uint32_t y, std::uint32_t z) {
  Grid grid;
  grid.count = {x, y, z};
  grid.face_size = 64;
  return grid;
}

// The grids are even, odd, flat and long: no side needs to be a power of two.
const std::vector<Grid>& grids() {
  static const std::vector<Grid> all = {gridOf(2, 2, 2), gridOf(3, 5, 2), gridOf(8, 8, 8), gridOf(9, 4, 7),
                                        gridOf(33, 2, 3)};
  return all;
}

TEST(Shard, ranksCountThePointsInMortonOrder) {
  for (const Grid& grid : grids()) {
    const auto points = pointsInMortonOrder(grid);
    for (std::uint64_t rank = 0; rank < points.size(); ++rank) {
      ASSERT_EQ(mortonRank(grid, points[rank]), rank);
      ASSERT_EQ(pointAtMortonRank(grid, rank), points[rank]);
    }
  }
}

TEST(Shard, ranksWorkOnTheLargestGrid) {
  const Grid grid = gridOf(kMaxGridIndex + 1, kMaxGridIndex + 1, 2);
  const std::uint64_t last = grid.pointCount() - 1;
  EXPECT_EQ(pointAtMortonRank(grid, last), glm::uvec3(kMaxGridIndex, kMaxGridIndex, 1));
  EXPECT_EQ(mortonRank(grid, {kMaxGridIndex, kMaxGridIndex, 1}), last);
}

TEST(Shard, shardsDivideThePointsWithoutGapOrOverlap) {
  for (const Grid& grid : grids()) {
    for (const std::uint32_t count : {1U, 2U, 3U, 7U, 100U, kMaxShards}) {
      std::uint64_t next = 0;
      std::uint64_t smallest = ~std::uint64_t{0};
      std::uint64_t largest = 0;
      for (std::uint32_t i = 0; i < count; ++i) {
        const PointRange range = pointsOf({i, count}, grid);
        EXPECT_EQ(range.first, next);
        next = range.end;
        smallest = std::min(smallest, range.size());
        largest = std::max(largest, range.size());
      }
      EXPECT_EQ(next, grid.pointCount());
      EXPECT_LE(largest - smallest, 1U);
    }
  }
}

// Compares two ways: by ranges of ranks, and by the shards' first keys.
TEST(Shard, everyKeyBelongsToTheShardWhoseRangeHoldsItsPoint) {
  for (const Grid& grid : grids()) {
    for (const std::uint32_t count : {1U, 2U, 3U, 7U, 100U}) {
      const ShardLookup lookup(grid, count);
      std::uint64_t rank = 0;
      for (const glm::uvec3& p : pointsInMortonOrder(grid)) {
        const std::uint32_t index = lookup.shardOf({p.x, p.y, p.z, 5});
        EXPECT_TRUE(pointsOf({index, count}, grid).contains(rank)) << index << " of " << count;
        ++rank;
      }
    }
  }
}

// The example stands in docs/formats/repository.md, "Shards".
TEST(Shard, theWorkedExampleOfTheFormatHolds) {
  const Grid grid = gridOf(3, 5, 2);
  const std::uint64_t firsts[] = {0, 7, 15, 22};
  for (std::uint32_t i = 0; i < 4; ++i) EXPECT_EQ(pointsOf({i, 4}, grid).first, firsts[i]);
  EXPECT_EQ(pointAtMortonRank(grid, 7), glm::uvec3(1, 1, 1));
  EXPECT_EQ(pointAtMortonRank(grid, 15), glm::uvec3(1, 3, 0));
  EXPECT_EQ((FaceKey{1, 1, 1, 0}).code(), 0x1c000U);
  EXPECT_EQ((FaceKey{1, 3, 0, 0}).code(), 0x4c000U);
}

TEST(Shard, parseShardReadsItsText) {
  EXPECT_EQ(*parseShard("3/16"), (Shard{3, 16}));
  EXPECT_EQ(*parseShard("0/1"), (Shard{0, 1}));
  for (const char* bad : {"", "/", "3", "3/", "/4", "4/4", "-1/4", "1/0", "1/5000", "1/4/2", " 1/4", "1/4 ", "a/4",
                          "1.5/4", "99999999999/4"}) {
    const auto refused = parseShard(bad);
    ASSERT_FALSE(refused) << bad;
    EXPECT_NE(refused.error().message.find(std::string("'") + bad + "'"), std::string::npos);
  }
}

TEST(Shard, directoryNamesAreReadBack) {
  EXPECT_EQ(directoryNameOf({3, 16}), "shard-0003-of-0016");
  EXPECT_EQ(shardOfDirectoryName("shard-0003-of-0016"), (Shard{3, 16}));
  for (const char* other : {"shard-0016-of-0016", "shard-3-of-16", "shard-0003-of-0016x", "shard-00a3-of-0016",
                            "shard-0003-of-9999", "data.mdb", ""})
    EXPECT_FALSE(shardOfDirectoryName(other)) << other;
}

TEST(Gaps, areTheRunsBetweenPresentKeys) {
  const Grid grid = gridOf(3, 5, 2);
  const auto points = pointsInMortonOrder(grid);
  const auto key = [&](std::size_t place) {
    const glm::uvec3 p = points[place / 6];
    return FaceKey{p.x, p.y, p.z, static_cast<std::uint32_t>(place % 6)};
  };
  // Shard 1 of 3 holds places 60 … 119, of which 60, 70 … 75 and 119 are missing.
  const ExpectedPoints expected_points(grid, {1, 3}, nullptr);
  GapFinder finder(expected_points);
  for (std::size_t place = 0; place < 180; ++place)
    if (place != 60 && (place < 70 || place > 75) && place != 119) finder.addPresentKey(key(place));
  finder.finish();
  const std::vector<Gap> expected = {{key(60), key(60), 1}, {key(70), key(75), 6}, {key(119), key(119), 1}};
  EXPECT_EQ(finder.gaps(), expected);

  GapFinder none(expected_points);
  none.finish();
  EXPECT_EQ(none.gaps(), (std::vector<Gap>{{key(60), key(119), 60}}));
}

// One cell of four steps has eight corners, of which the tree leaves out one.
TEST(Gaps, holdOnlySampledPointsWhereThereIsATree) {
  const Grid grid = gridOf(5, 5, 5);
  SampleTree tree(grid, 4);
  tree.leaveOut({4, 4, 0});
  const ExpectedPoints points(grid, {0, 1}, &tree);
  ASSERT_EQ(points.size(), 7U);
  for (std::uint64_t place = 0; place < 7; ++place) EXPECT_EQ(points.placeOf(points.at(place)), place);
  EXPECT_EQ(points.at(2), glm::uvec3(0, 4, 0));
  for (const glm::uvec3 other : {glm::uvec3(1, 0, 0), glm::uvec3(4, 4, 0), glm::uvec3(3, 3, 3)})
    EXPECT_FALSE(points.placeOf(other)) << other.x;

  GapFinder finder(points);
  finder.addPresentKey({0, 0, 0, 0});
  finder.addPresentKey({1, 0, 0, 3});  // nobody expects it, so it fills no gap
  finder.addPresentKey({0, 4, 0, 0});
  finder.finish();
  const std::vector<Gap> expected = {{{0, 0, 0, 1}, {4, 0, 0, 5}, 11}, {{0, 4, 0, 1}, {4, 4, 4, 5}, 29}};
  EXPECT_EQ(finder.gaps(), expected);

  // Shards of the same tree divide its points.
  std::uint64_t sum = 0;
  for (std::uint32_t i = 0; i < 3; ++i) sum += ExpectedPoints(grid, {i, 3}, &tree).size();
  EXPECT_EQ(sum, 7U);
}

}  // namespace
}  // namespace repository
