#pragma once
// Writes the file from the tiles' trees: a top tree joins them, spheres are encoded relative to their parents from the
// top down, and nodes are written level by level (Rusinkiewicz and Levoy 2000, sections 3.1 and 3.2).
#include <functional>
#include <string>

#include "lod/qsplat/builder/subtree_store.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

struct FileBuildOptions {
  bool colors = false;
  bool wide_pointers = false;  ///< use them even where offsets are short; long offsets get them in any case
  unsigned threads = 0;
  std::string runs_path;   ///< the work file of encoded nodes
  std::string plain_path;  ///< the work file of the plain form; empty writes the plain form, else the coded one
  std::function<bool(const std::string& stage, double done)> progress;  ///< may be empty; false cancels
};

/// The file appears at `path` whole or not at all. At least one tile must have nodes. Errors: kNoSpace, kIo,
/// kCancelled, kUnsupported (a tree of more than 128 levels).
base::Result<Header> writeTree(const SubtreeStore& subtrees, const std::string& path, const FileBuildOptions& options);

}  // namespace lod::qsplat::builder
