// Feeds any text to the readers of a store's parameters and of shard directory names. An accepted grid must be
// divisible into shards.
#include <string>

#include "base/check.h"
#include "repository/sampling/parameters.h"
#include "repository/sampling/shard.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {
namespace {

base::Bytes bytesOf(const std::string& text) {
  return {text.begin(), text.end()};
}

void divide(const repository::Grid& grid) {
  const std::uint64_t points = grid.pointCount();
  if (points == 0) return;
  for (const std::uint64_t rank : {std::uint64_t{0}, points / 3, points - 1}) {
    const glm::uvec3 point = repository::pointAtMortonRank(grid, rank);
    LUMIGRID_CHECK_EQ(repository::mortonRank(grid, point), rank);
    const repository::ShardLookup lookup(grid, 5);
    const std::uint32_t index = lookup.shardOf({point.x, point.y, point.z, 0});
    LUMIGRID_CHECK(repository::pointsOf({index, 5}, grid).contains(rank));
  }
}

// The parameters hold a tree over 5 x 5 x 5 points in hexadecimal.
std::string treeOfFive() {
  repository::Grid grid;
  grid.count = glm::uvec3(5);
  const std::string text = repository::withTree("\n}\n", repository::SampleTree(grid, 2));
  const std::size_t begin = text.find(": \"") + 3;
  return text.substr(begin, text.find('"', begin) - begin);
}

}  // namespace

std::vector<base::Bytes> seeds() {
  return {
      bytesOf("{\n\"version\": 1,\n\"grid\": {\"first\": [-2, -2, -2], \"spacing\": 2, \"count\": [3, 9, 4], "
              "\"face_size\": 64},\n\"quality\": 85\n}\n"),
      bytesOf("{\"grid\": {\"first\": [1e6, 0, -0.5], \"spacing\": 0.349999994, \"count\": [1048576, 2, 2], "
              "\"face_size\": 1}}"),
      bytesOf(
          "{\n\"grid\": {\"first\": [0, 0, 0], \"spacing\": 1, \"count\": [5, 5, 5], \"face_size\": 8},\n\"tree\": \"" +
          treeOfFive() + "\"\n}\n"),
      bytesOf("shard-0003-of-0016"), bytesOf("3/16")};
}

void fuzzOne(base::ByteView bytes) {
  const std::string text(bytes.begin(), bytes.end());
  if (const auto points = repository::sampledPointsFromMeta(text, "images")) divide(points->grid);
  if (const auto shard = repository::shardOfDirectoryName(text))
    LUMIGRID_CHECK_EQ(repository::directoryNameOf(*shard), text);
  if (const auto shard = repository::parseShard(text)) {
    LUMIGRID_CHECK_LT(shard->index, shard->count);
    LUMIGRID_CHECK(repository::shardOfDirectoryName(repository::directoryNameOf(*shard)) == *shard);
  }
  (void)repository::firstDifference(text, "{\n\"quality\": 85\n}");
}

}  // namespace fuzz
