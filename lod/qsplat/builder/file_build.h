#pragma once
// From the tiles' trees to the file: one tree over them, spheres made relative from the top down, then level by level
// (Rusinkiewicz and Levoy 2000, sections 3.1 and 3.2). Private to lod/build/qsplat.
#include <functional>
#include <string>

#include "lod/qsplat/builder/subtree_store.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

struct FileBuildOptions {
  bool colors = false;
  bool wide_pointers = false;  ///< also where offsets are short; they are taken by themselves where they must be
  unsigned threads = 0;
  std::string runs_path;   ///< of the work file
  std::string plain_path;  ///< of another one; empty: the file is in the plain form, else in the coded one
  std::function<bool(const std::string& stage, double done)> progress;  ///< may be empty; false cancels
};

/// The file appears at `path` whole or not at all. At least one tile has nodes. Errors: kNoSpace, kIo, kCancelled;
/// kUnsupported for a tree of more than 128 levels.
base::Result<lod::qsplat::Header> writeTree(const SubtreeStore& subtrees, const std::string& path,
                                            const FileBuildOptions& options);

}  // namespace lod::qsplat::builder
