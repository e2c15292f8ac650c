#include "repository/sampling/shard.h"

#include <algorithm>
#include <bit>

#include "base/check.h"
#include "base/format_text.h"
#include "base/number.h"

namespace repository {
namespace {

// The number of grid points in the cube of `side` at `corner`.
std::uint64_t pointsInCube(const glm::uvec3& corner, std::uint32_t side, const glm::uvec3& count) {
  std::uint64_t points = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const std::uint32_t left = count[axis] > corner[axis] ? count[axis] - corner[axis] : 0;
    points *= std::min(left, side);
  }
  return points;
}

// Half the side of the smallest cube, a power of two, that holds the grid's points.
std::uint32_t halfOfRoot(const glm::uvec3& count) {
  return std::bit_ceil(std::max({count.x, count.y, count.z})) / 2;
}

// The first rank of shard i is floor(points · i / n); this form does not overflow.
std::uint64_t firstRank(std::uint64_t points, std::uint32_t index, std::uint32_t count) {
  return points / count * index + points % count * index / count;
}

}  // namespace

base::Result<Shard> parseShard(const std::string& text) {
  const auto wrong = [&](const std::string& problem) {
    return base::Error{base::ErrorCode::kInvalidInput, "shard '" + text + "': " + problem};
  };
  const std::size_t slash = text.find('/');
  const auto index = base::parseDecimal(text.substr(0, slash));
  const auto count = slash == std::string::npos ? std::nullopt : base::parseDecimal(text.substr(slash + 1));
  if (!index || !count) return wrong("say i/n, such as 3/16");
  if (*count < 1 || *count > kMaxShards) return wrong("n must be 1 to " + std::to_string(kMaxShards));
  if (*index >= *count) return wrong("i must be 0 to n - 1, here " + std::to_string(*count - 1));
  return Shard{static_cast<std::uint32_t>(*index), static_cast<std::uint32_t>(*count)};
}

std::string directoryNameOf(const Shard& shard) {
  return base::formatText("shard-%04u-of-%04u", shard.index, shard.count);
}

std::optional<Shard> shardOfDirectoryName(const std::string& name) {
  if (name.size() != 18 || !name.starts_with("shard-") || name.substr(10, 4) != "-of-") return std::nullopt;
  const auto index = base::parseDecimal(name.substr(6, 4));
  const auto count = base::parseDecimal(name.substr(14));
  if (!index || !count || *count > kMaxShards || *index >= *count) return std::nullopt;
  return Shard{static_cast<std::uint32_t>(*index), static_cast<std::uint32_t>(*count)};
}

PointRange pointsOf(const Shard& shard, const Grid& grid) {
  const std::uint64_t points = grid.pointCount();
  return {firstRank(points, shard.index, shard.count), firstRank(points, shard.index + 1, shard.count)};
}

std::uint64_t mortonRank(const Grid& grid, const glm::uvec3& point) {
  LUMIGRID_CHECK(grid.contains({point.x, point.y, point.z, 0}));
  std::uint64_t rank = 0;
  glm::uvec3 corner(0);
  for (std::uint32_t half = halfOfRoot(grid.count); half > 0; half /= 2) {
    std::uint32_t child = 0;
    for (int axis = 0; axis < 3; ++axis) child |= point[axis] >= corner[axis] + half ? 1U << axis : 0U;
    for (std::uint32_t before = 0; before < child; ++before)
      rank += pointsInCube(childCorner(corner, half, before), half, grid.count);
    corner = childCorner(corner, half, child);
  }
  return rank;
}

glm::uvec3 pointAtMortonRank(const Grid& grid, std::uint64_t rank) {
  LUMIGRID_CHECK_LT(rank, grid.pointCount());
  glm::uvec3 corner(0);
  for (std::uint32_t half = halfOfRoot(grid.count); half > 0; half /= 2) {
    std::uint32_t child = 0;
    for (;; ++child) {
      const std::uint64_t points = pointsInCube(childCorner(corner, half, child), half, grid.count);
      if (rank < points) break;
      rank -= points;
    }
    corner = childCorner(corner, half, child);
  }
  return corner;
}

ShardLookup::ShardLookup(const Grid& grid, std::uint32_t count) {
  for (std::uint32_t index = 0; index < count; ++index) {
    const std::uint64_t first = pointsOf({index, count}, grid).first;
    if (first == grid.pointCount()) break;  // only empty shards follow
    first_codes_.push_back(codeOfPoint(pointAtMortonRank(grid, first)));
  }
}

std::uint32_t ShardLookup::shardOf(const FaceKey& key) const {
  const auto next = std::upper_bound(first_codes_.begin(), first_codes_.end(), key.code());
  LUMIGRID_CHECK(next != first_codes_.begin());
  return static_cast<std::uint32_t>(next - first_codes_.begin()) - 1;
}

}  // namespace repository
