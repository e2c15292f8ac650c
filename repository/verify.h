#pragma once
// Is a repository whole? And what does it hold? Used by `lumigrid verify` and `lumigrid info`.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/packs/pack_store.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/shard.h"
#include "repository/store.h"

namespace repository {

/// Faults after which verify() stops looking for more.
inline constexpr std::size_t kMaxFaults = 100;

/// One line for each fault, none when all is well: a face of the grid that is missing, a value whose checksum or
/// lengths are wrong, a JPEG or mask that cannot be decoded or is of another size than grid.face_size, a key that is no
/// sampling point (of the grid, or of `tree` where not all points are sampled). Ranges of missing faces are one line.
/// Decodes everything on `threads` threads (0: all cores). An error when the store itself cannot be read.
base::Result<std::vector<std::string>> verify(const Store& store, const Grid& grid, const SampleTree* tree = nullptr,
                                              unsigned threads = 0);

/// The same of a published repository, and all that PackStore::check finds: what is damaged or lost is a fault, and
/// the rest is looked at. `progress` is told how many values were read, now and then, and returns false to stop.
std::vector<std::string> verify(const PackStore& packs, const Grid& grid, const SampleTree* tree = nullptr,
                                unsigned threads = 0,
                                const std::function<bool(std::uint64_t values)>& progress = nullptr);

/// The same for the store of one shard: only its points are expected, and keys of other shards are faults.
base::Result<std::vector<std::string>> verifyShard(const Store& store, const Grid& grid, const Shard& shard,
                                                   const SampleTree* tree = nullptr, unsigned threads = 0);

struct RemovalCounts {
  std::uint64_t damaged = 0;  ///< values that verify would call wrong
  std::uint64_t orphans = 0;  ///< values whose key is no face of the shard, or not at a sampling point
};
/// Erases what verifyShard finds wrong, so that only missing faces are left to render. The checks are verify's, all of
/// them: every value is decoded.
base::Result<RemovalCounts> removeFaulty(Store& store, const Grid& grid, const Shard& shard,
                                         const SampleTree* tree = nullptr, unsigned threads = 0);

struct StoreContents {
  std::uint64_t faces = 0;  ///< values, empty flags included
  std::uint64_t empty = 0;  ///< empty flags
  std::uint64_t jpeg_bytes = 0;
  std::uint64_t coverage_bytes = 0;
  std::uint64_t unreadable = 0;  ///< values that decodeFaceValue refuses
};
/// Reads every value once.
base::Result<StoreContents> contentsOf(const Store& store);

}  // namespace repository
