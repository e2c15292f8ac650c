#pragma once
// Writes the file from the tiles' trees: a top tree joins them, spheres are encoded relative to their parents from the
// top down, and nodes are written level by level (Rusinkiewicz and Levoy 2000, sections 3.1 and 3.2).
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/qsplat/builder/tree.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

/// The part of a tile's tree that is kept in memory.
struct StoredSubtree {
  Splat root;
  TreeNode root_node;
  std::uint64_t added_leaves = 0;  ///< as in Subtree
  std::uint64_t nodes = 0;
  std::uint64_t offset = 0;  ///< where its nodes lie in the store
};

/// The tiles' trees on disk, which is also the journal of the tiles that are done.
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

struct FileBuildOptions {
  bool colors = false;
  bool points = false;         ///< leaves are points, of which some may lie far from all others (lone_leaves.h)
  bool wide_pointers = false;  ///< use them even where offsets are short; long offsets get them in any case
  unsigned threads = 0;
  std::string runs_path;   ///< the work file of encoded nodes
  std::string plain_path;  ///< the work file of the plain form; empty writes the plain form, else the coded one
  std::function<bool(const std::string& stage, double done)> progress;  ///< may be empty; false cancels
};

struct WrittenTree {
  Header header;
  std::uint64_t repeated_leaves = 0;  ///< how many leaves repeat another (lone_leaves.h)
};

/// The file appears at `path` whole or not at all. At least one tile must have nodes. Errors: kNoSpace, kIo,
/// kCancelled, kUnsupported (a tree of more than 128 levels).
base::Result<WrittenTree> writeTree(const SubtreeStore& subtrees, const std::string& path,
                                    const FileBuildOptions& options);

}  // namespace lod::qsplat::builder
