#pragma once
// images/ as a whole: one store, or one for each shard, read as one (docs/formats/repository.md, "Shards"). Shards are
// merged by listing them; nothing is copied.
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/sampling/gaps.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/shard.h"
#include "repository/store.h"

namespace repository {

/// What lies below images/.
struct Layout {
  bool undivided = false;     ///< images/ itself holds a store
  std::vector<Shard> shards;  ///< directories with the name of a shard, by count and then by index
};
/// An images/ that is not there holds nothing.
base::Result<Layout> layoutOf(const std::string& images);

/// The directory of one store of a repository of `shards` shards, 0 for one that is not divided.
std::string storeDirectory(const std::string& images, std::uint32_t shards, std::uint32_t index);

/// The repository in directory `images`, for reading: a Store over the one store or over all shards, which picks the
/// shard by the key's range. A shard that is not there yet is read as soon as it appears; until then its keys are
/// absent. Keys that do not belong to the shard that holds them are passed over, so order is that of Store::forEach.
/// `shards`: the division that scene.json records (0: none); without it, the one that the directories show.
/// Errors: kNotFound when nothing is there yet; kInvalidInput when stores of several divisions are mixed, or shards
/// were built with different parameters (both named).
base::Result<std::unique_ptr<Store>> openRepository(const std::string& images,
                                                    std::optional<std::uint32_t> shards = std::nullopt);

/// What a repository lacks, shard by shard.
struct ShardGaps {
  Shard shard;
  std::uint64_t faces = 0;     ///< all that are missing
  std::uint64_t cells = 0;     ///< of adaptive sampling: still to be judged, after which more faces may be missing
  bool being_written = false;  ///< by another process: not looked into, and its faces count as missing, all of them
  std::vector<Gap> gaps;
};
/// The shards that lack anything; an undivided repository is shard 0/1. `shards` as in openRepository. Reads the keys
/// only. A store that another process writes is not opened: that process may be on another machine, where LMDB's table
/// of readers does not reach. A store that is not there lacks everything; errors as openRepository, and kInvalidInput
/// for a repository of another grid. What a store's own tree samples is expected; `first_tree`: the one with which
/// adaptive sampling begins, for a store that has none yet; null where the whole grid is sampled.
base::Result<std::vector<ShardGaps>> findMissing(const std::string& images, std::uint32_t shards, const Grid& grid,
                                                 const SampleTree* first_tree = nullptr);

}  // namespace repository
