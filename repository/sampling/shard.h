#pragma once
// A grid divided among processes: shard i of n is the i-th of n contiguous ranges of its Morton order (DESIGN section
// 5). Which points belong to a shard follows from grid, i and n alone, so that shards can be rendered anywhere, at any
// time, in any order.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"

namespace repository {

/// Most shards of a repository: a reader may hold every shard's files open at once.
inline constexpr std::uint32_t kMaxShards = 4096;

struct Shard {
  std::uint32_t index = 0;  ///< 0 … count − 1
  std::uint32_t count = 1;  ///< 1 … kMaxShards
  friend bool operator==(const Shard&, const Shard&) = default;
};

/// "3/16"; an error that says what is wrong with it.
base::Result<Shard> parseShard(const std::string& text);
/// The shard's directory below images/: "shard-0003-of-0016".
std::string directoryNameOf(const Shard& shard);
/// The inverse; nothing for any other name.
std::optional<Shard> shardOfDirectoryName(const std::string& name);

/// Places first … end − 1 in the Morton order of a grid's points.
struct PointRange {
  std::uint64_t first = 0, end = 0;
  std::uint64_t size() const { return end - first; }
  bool contains(std::uint64_t rank) const { return first <= rank && rank < end; }
  friend bool operator==(const PointRange&, const PointRange&) = default;
};

/// The shard's points: sizes differ by at most one, and some are empty where shards outnumber points.
PointRange pointsOf(const Shard& shard, const Grid& grid);

/// How many points of the grid come before this one of its points in Morton order. No list of points is made: it
/// follows from the counts, halving by halving.
std::uint64_t mortonRank(const Grid& grid, const glm::uvec3& point);
/// The inverse: the point of the grid at place `rank`, rank < pointCount().
glm::uvec3 pointAtMortonRank(const Grid& grid, std::uint64_t rank);

/// Which key belongs to which shard, by the first key of each.
class ShardLookup {
 public:
  ShardLookup(const Grid& grid, std::uint32_t count);
  /// Of a key of the grid's.
  std::uint32_t shardOf(const FaceKey& key) const;

 private:
  std::vector<std::uint64_t> first_codes_;  // ascending; of an empty shard, that of the next one
};

}  // namespace repository
