#pragma once
// The tiles' trees on disk, which is also the journal of the tiles that are done.
#include <optional>
#include <string>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/qsplat/builder/tree.h"

namespace lod::qsplat::builder {

/// The part of a tile's tree that is kept in memory.
struct StoredSubtree {
  Splat root;
  TreeNode root_node;
  std::vector<std::uint32_t> level_nodes;
  std::uint64_t added_leaves = 0;  ///< as in Subtree
  std::uint64_t nodes = 0;
  std::uint64_t offset = 0;  ///< where its nodes lie in the store
};

class SubtreeStore {
 public:
  /// Creates `path`, or with `resume` reads and continues it. Errors: kNoSpace, kIo.
  static base::Result<SubtreeStore> open(const std::string& path, bool resume, std::size_t tiles);
  /// Adds a tile's tree, which has no nodes where the tile has no leaves. Safe from several threads. Errors: kNoSpace,
  /// kIo.
  base::Result<void> add(std::uint32_t tile, const Subtree& tree);
  bool has(std::size_t tile) const { return tiles_[tile].has_value(); }
  const StoredSubtree& operator[](std::size_t tile) const { return *tiles_[tile]; }
  std::size_t tiles() const { return tiles_.size(); }
  /// Reads the tile's nodes, breadth first. Safe from several threads. Errors: kIo.
  base::Result<std::vector<TreeNode>> nodes(std::size_t tile) const;
  std::uint64_t bytes() const { return log_.size(); }

 private:
  ingest::RecordLog log_;
  std::vector<std::optional<StoredSubtree>> tiles_;  // each is written by the one thread that adds it
};

}  // namespace lod::qsplat::builder
