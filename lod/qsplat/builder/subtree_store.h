#pragma once
// The tiles' trees on disk, and the journal of which are done in one. Private to lod/build/qsplat.
#include <optional>
#include <string>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/qsplat/builder/tree.h"

namespace lod::qsplat::builder {

/// A tile's tree, as much as is kept in memory.
struct StoredSubtree {
  Splat root;
  TreeNode root_node;
  std::vector<std::uint32_t> level_nodes;
  std::uint64_t added_leaves = 0;  ///< as in Subtree
  std::uint64_t nodes = 0;
  std::uint64_t offset = 0;  ///< of its nodes in the store
};

class SubtreeStore {
 public:
  /// `path` is created, or read and continued when `resume`. Errors: kNoSpace, kIo.
  static base::Result<SubtreeStore> open(const std::string& path, bool resume, std::size_t tiles);
  /// Tiles without leaves have an entry too: no nodes. Safe from several threads. Errors: kNoSpace, kIo.
  base::Result<void> add(std::uint32_t tile, const Subtree& tree);
  bool has(std::size_t tile) const { return tiles_[tile].has_value(); }
  const StoredSubtree& operator[](std::size_t tile) const { return *tiles_[tile]; }
  std::size_t tiles() const { return tiles_.size(); }
  /// Breadth first. Safe from several threads. Errors: kIo.
  base::Result<std::vector<TreeNode>> nodes(std::size_t tile) const;
  std::uint64_t bytes() const { return log_.size(); }

 private:
  ingest::RecordLog log_;
  std::vector<std::optional<StoredSubtree>> tiles_;  // each is written by the one thread that adds it
};

}  // namespace lod::qsplat::builder
