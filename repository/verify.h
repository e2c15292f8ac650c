#pragma once
// Checks whether a repository is whole and counts what it holds, for `lumigrid verify` and `lumigrid info`.
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

/// verify() stops after so many faults: a damaged disk would otherwise print one line for each of millions of values.
inline constexpr std::size_t kMaxFaults = 100;

/// Returns one line for each fault, and none when the repository is whole. A fault is a face of the grid that is
/// missing, a tile that another names and that is missing, or that none names, a value whose checksum or lengths are
/// wrong, a JPEG or mask that cannot be decoded or has another size than grid.imageSide(), or a key that is no sampling
/// point (of the grid, or of `tree` where not all points are sampled). In
/// the store of one shard only its points are expected, and keys of other shards are faults. A range of missing faces
/// takes one line. Every value is decoded, on `threads` threads (0: all cores). The result is an error when the store
/// itself cannot be read.
base::Result<std::vector<std::string>> verify(const Store& store, const Grid& grid, const SampleTree* tree = nullptr,
                                              unsigned threads = 0, const Shard& shard = {0, 1});

/// Checks a published repository likewise, together with all that PackStore::check finds. Damaged and lost objects are
/// faults, and the others are still checked. `progress` is called every 256 values with their number so far; it returns
/// false to stop.
std::vector<std::string> verify(const PackStore& packs, const Grid& grid, const SampleTree* tree = nullptr,
                                unsigned threads = 0,
                                const std::function<bool(std::uint64_t values)>& progress = nullptr);

struct RemovalCounts {
  std::uint64_t damaged = 0;  ///< values that verify would call wrong
  /// Values whose key is no face of the shard, or not at a sampling point, and tiles that no other names.
  std::uint64_t orphans = 0;
};
/// Erases all values that verify finds wrong, so that only missing faces are left to render. Every value is decoded.
base::Result<RemovalCounts> removeFaulty(Store& store, const Grid& grid, const Shard& shard,
                                         const SampleTree* tree = nullptr, unsigned threads = 0);

struct StoreContents {
  std::uint64_t values = 0;  ///< of tiles, or of plain faces; empty flags included
  std::uint64_t faces = 0;   ///< of which a value is here
  std::uint64_t empty = 0;   ///< empty flags
  std::uint64_t jpeg_bytes = 0;
  std::uint64_t coverage_bytes = 0;
  std::uint64_t unreadable = 0;  ///< values that decodeFaceValue refuses
};
/// Reads every value once.
base::Result<StoreContents> contentsOf(const Store& store);

}  // namespace repository
