#pragma once
// How often each face and each patch group of a scene was sent to viewers (docs/formats/access.md): the access
// frequency by which Okamoto 2011 would place sampling points (its future work). Counts are plain sums since the file
// was begun: sums of several servers add up in any order, and no clocks have to agree.
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"

namespace repository {

/// What counts belong to: keys and group numbers mean nothing in another scene.
struct AccessIdentity {
  Grid grid;  ///< count 0: the scene has no images
  std::uint32_t group_count = 0;
  friend bool operator==(const AccessIdentity&, const AccessIdentity&) = default;
};

/// Rows are strictly ascending by key or group, counts at least 1.
struct AccessCounts {
  std::vector<std::pair<FaceKey, std::uint64_t>> faces;
  std::vector<std::pair<std::uint32_t, std::uint64_t>> groups;
  /// Sent too, but not kept apart: there were more different keys at a time than memory was given.
  std::uint64_t uncounted = 0;
  std::int64_t since = 0, until = 0;  ///< Unix seconds: counting began; newest count. since <= until

  std::uint64_t facesSent() const;   ///< sum over `faces`
  std::uint64_t groupsSent() const;  ///< sum over `groups`
  friend bool operator==(const AccessCounts&, const AccessCounts&) = default;
};

struct AccessFile {
  AccessIdentity identity;
  AccessCounts counts;
};

/// Sums; a sum that would not fit stays at the largest number. Of the times the earlier `since` and the later `until`.
AccessCounts addCounts(const AccessCounts& a, const AccessCounts& b);

/// A whole file. Counts must be as AccessCounts says, and within the identity's grid and groups.
base::Bytes encodeAccess(const AccessIdentity& identity, const AccessCounts& counts);
/// Refuses everything that encodeAccess would not have written.
base::Result<AccessFile> decodeAccess(base::ByteView bytes);

/// SCENE/access.lga.
std::string accessFileOf(const std::string& scene_directory);
/// The counts of a scene, its files (one, or one of each server that wrote to a place of its own) added up. Errors name
/// the file: kNotFound, kInvalidInput (damaged; or of another scene than `identity`).
base::Result<AccessCounts> loadAccess(const std::vector<std::string>& files, const AccessIdentity& identity);

/// Adds to the file at `path`, or makes it; counts of other processes that do the same stay. When this returns without
/// an error all is added and durable, else nothing is. Errors: kBusy (another process has held PATH.lock for
/// `patience_seconds`), kInvalidInput (what is there is damaged or of another scene; it is left as it is), kIo,
/// kNoSpace.
base::Result<void> addToAccessFile(const std::string& path, const AccessIdentity& identity, const AccessCounts& more,
                                   double patience_seconds);

/// How often a grid point's six faces were sent, together.
struct PointUse {
  glm::uvec3 point{0};
  std::uint64_t sent = 0;
};
/// Every point with counts, most sent first; equal ones in Morton order.
std::vector<PointUse> rankPoints(const AccessCounts& counts);

/// How much a cell of 8 points is used.
struct CellUse {
  glm::uvec3 lower{0};  ///< its corner with the smallest indices; the others are `edge` further
  /// The fourth smallest of what was sent of its 8 corners. A viewer within a cell gets its corners, but for those that
  /// are not stored (at most 3 count as such here), while a neighbour that nobody visits shares 4 of them at most and
  /// so has 0.
  std::uint64_t use = 0;
  std::uint64_t sent = 0;  ///< sum over the 8 corners
};
/// Cells whose lower corners are multiples of `edge` (1 or more: cells of an octree's level have a power of two), and
/// which have a corner with counts; most used first, then most sent, then in Morton order. What `build --refine-from`
/// spends its budget by.
std::vector<CellUse> rankCells(const AccessCounts& counts, const Grid& grid, std::uint32_t edge = 1);

}  // namespace repository
