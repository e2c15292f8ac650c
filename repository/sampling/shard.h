#pragma once
// A grid divided among processes: shard i of n is the i-th of n contiguous ranges of its Morton order. Grid, i and n
// alone decide which points belong to a shard, so that shards can be rendered anywhere, at any time, in any order
// (docs/formats/repository.md, "Shards").
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"

namespace repository {

/// A reader may hold every shard's files open at once, so their number is bounded; directory names have four digits.
inline constexpr std::uint32_t kMaxShards = 4096;

struct Shard {
  std::uint32_t index = 0;  ///< 0 … count − 1
  std::uint32_t count = 1;  ///< 1 … kMaxShards
  friend bool operator==(const Shard&, const Shard&) = default;
};

/// Reads "3/16". The error says what is wrong with the text.
base::Result<Shard> parseShard(const std::string& text);
/// The shard's directory below images/: "shard-0003-of-0016".
std::string directoryNameOf(const Shard& shard);
/// The inverse of directoryNameOf(); nothing for any other name.
std::optional<Shard> shardOfDirectoryName(const std::string& name);

/// The places first … end − 1 in the Morton order of a grid's points.
struct PointRange {
  std::uint64_t first = 0, end = 0;
  std::uint64_t size() const { return end - first; }
  bool contains(std::uint64_t rank) const { return first <= rank && rank < end; }
  friend bool operator==(const PointRange&, const PointRange&) = default;
};

/// The shard's points. Sizes of shards differ by at most one; where shards outnumber points some are empty.
PointRange pointsOf(const Shard& shard, const Grid& grid);

/// The number of grid points that come before `point` in Morton order. It goes down the octree and adds up the points
/// of the cubes that it passes, so no list of points is made.
std::uint64_t mortonRank(const Grid& grid, const glm::uvec3& point);
/// The inverse of mortonRank(): the point of the grid at place `rank`, rank < pointCount().
glm::uvec3 pointAtMortonRank(const Grid& grid, std::uint64_t rank);

/// Finds the shard of a key by a binary search among the shards' first keys.
class ShardLookup {
 public:
  ShardLookup(const Grid& grid, std::uint32_t count);
  /// The index of the shard that holds `key`, which must lie in the grid.
  std::uint32_t shardOf(const FaceKey& key) const;

 private:
  std::vector<std::uint64_t> first_codes_;  // ascending; an empty shard has the first code of the next shard
};

}  // namespace repository
