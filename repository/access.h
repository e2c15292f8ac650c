#pragma once
// Counts how often each face and each patch group of a scene was sent to viewers (docs/formats/access.md). Okamoto 2011
// proposes, as future work, to place sampling points by this frequency. Counts are plain sums since the file was begun,
// so those of several servers add up in any order and no clocks have to agree.
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/hash/sha256.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"

namespace repository {

/// Identifies the scene that counts belong to: keys and group numbers mean nothing in another one.
struct AccessIdentity {
  Grid grid;  ///< count 0: the scene has no images
  std::uint32_t group_count = 0;
  base::Sha256Digest hierarchy{};  ///< as base::hierarchyDigest()
  friend bool operator==(const AccessIdentity&, const AccessIdentity&) = default;
};

/// Rows ascend strictly by key or group, and each count is at least 1.
struct AccessCounts {
  std::vector<std::pair<FaceKey, std::uint64_t>> faces;
  std::vector<std::pair<std::uint32_t, std::uint64_t>> groups;
  /// Faces and groups that were sent but not counted by key, since more keys came at a time than memory allowed.
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

/// Adds row by row, from the earlier `since` to the later `until`. A sum that would overflow stays at the largest
/// number.
AccessCounts addCounts(const AccessCounts& a, const AccessCounts& b);

/// Encodes a whole file. The rows must ascend and lie within the identity's grid and groups.
base::Bytes encodeAccess(const AccessIdentity& identity, const AccessCounts& counts);
/// Refuses all bytes that encodeAccess would not have written.
base::Result<AccessFile> decodeAccess(base::ByteView bytes);

/// SCENE/access.lga.
std::string accessFileOf(const std::string& scene_directory);
/// The file beside `path` that a scene's counts go to while the one at `path` has those of another scene:
/// SCENE/access-<first 16 digits of the hierarchy's digest>.lga.
std::string accessFileBeside(const std::string& path, const base::Sha256Digest& hierarchy);
/// Those of SCENE/access.lga and the file beside it that are there and whose counts are of the hierarchy. Where there
/// are files, but none of them is, the error says so. Errors as loadAccess().
base::Result<std::vector<AccessFile>> loadSceneAccess(const std::string& scene_directory,
                                                      const base::Sha256Digest& hierarchy);
/// The error of a file whose counts are not of the scene that they were sought for.
base::Error anotherSceneError(const std::string& path);
/// Adds up the counts in `files`: one file, or one of each server that wrote to a place of its own. Errors name the
/// file: kNotFound; kInvalidInput when it is damaged or belongs to another scene than `identity`.
base::Result<AccessCounts> loadAccess(const std::vector<std::string>& files, const AccessIdentity& identity);

/// Adds `more` to the file at `path`, or creates it; where that file has the counts of another scene, as servers of a
/// scene that was replaced leave it, to the one beside it. Returns which of the two it was. Counts that other processes
/// add at the same time are kept. On success all of `more` is added and durable; on an error nothing is. Errors: kBusy
/// when another process has held PATH.lock for `patience_seconds`; kInvalidInput when the file is damaged, kVersion
/// when it has another version (it stays unchanged); kIo, kNoSpace.
base::Result<std::string> addToAccessFile(const std::string& path, const AccessIdentity& identity,
                                          const AccessCounts& more, double patience_seconds);

/// How often the six faces of a grid point were sent.
struct PointUse {
  glm::uvec3 point{0};
  std::uint64_t sent = 0;  ///< sum over the six faces
};
/// All points with counts, most sent first; equal ones are in Morton order.
std::vector<PointUse> rankPoints(const AccessCounts& counts);

}  // namespace repository
