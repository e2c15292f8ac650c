#pragma once
// The directory images/ as a whole. It holds one store, or one for each shard, and is read as a single Store
// (docs/formats/repository.md, "Shards"). Shards are merged by listing their directories; nothing is copied.
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/sampling/expected_points.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/shard.h"
#include "repository/store.h"

namespace repository {

/// The stores below images/.
struct Layout {
  bool undivided = false;     ///< images/ itself holds a store
  std::vector<Shard> shards;  ///< directories with the name of a shard, by count and then by index
};
/// Lists the stores; there are none where the directory `images` does not exist.
base::Result<Layout> layoutOf(const std::string& images);

/// The directory of store `index` in a repository of `shards` shards; `shards` is 0 where it is not divided.
std::string storeDirectory(const std::string& images, std::uint32_t shards, std::uint32_t index);

/// Opens the repository in directory `images` for reading, as a Store over the one store or over all shards. A key is
/// looked up in the shard whose range holds it. A shard that is not there yet is read as soon as it appears; until then
/// its keys are absent. Keys that lie in a shard to which they do not belong are skipped, so forEach goes in ascending
/// order of keys. `shards` is the division that scene.json records (0: none); without it the directories decide.
/// Errors: kNotFound when nothing is there yet; kInvalidInput when stores of several divisions are mixed, or shards
/// were built with different parameters (the error names both).
base::Result<std::unique_ptr<Store>> openRepository(const std::string& images,
                                                    std::optional<std::uint32_t> shards = std::nullopt);

/// The faces that one shard lacks.
struct ShardGaps {
  Shard shard;
  std::uint64_t faces = 0;     ///< number of missing faces
  bool being_written = false;  ///< another process writes it: it was not opened, and all its faces count as missing
  std::vector<Gap> gaps;
};
/// The shards that lack anything; an undivided repository is shard 0/1. `shards` as in openRepository. Only keys are
/// read. A store that another process writes is not opened, because that process may run on another machine, where
/// LMDB's table of readers does not reach. A store that does not exist lacks everything. Expected are the points that a
/// store's own tree samples; `tree` stands for it in a store that does not exist yet, and is null where the whole grid
/// is sampled. `to_replace`: the faces that are there are no longer right, and count as missing too. Errors: those of
/// openRepository, and kInvalidInput for a repository of another grid.
base::Result<std::vector<ShardGaps>> findMissing(const std::string& images, std::uint32_t shards, const Grid& grid,
                                                 const SampleTree* tree = nullptr, bool to_replace = false);

}  // namespace repository
