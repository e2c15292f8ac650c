#pragma once
// Mesh or points in, qsplat.lgq out (Rusinkiewicz and Levoy 2000, sections 2.2 and 3; docs/formats/qsplat.md): leaves
// sorted to disk by tiles, a tree for each, one over all of them, then level by level into the file. Out of core: what
// does not fit the memory given lies in files of a work directory, and a build that was stopped or killed goes on from
// there.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/resource_limits.h"
#include "lod/ingest/source_import.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

/// Found by trying (docs/results/qsplat.md).
inline constexpr double kDice = 2.0;

struct BuildOptions {
  base::ResourceLimits limits;   ///< the output does not depend on them
  std::string work_directory;    ///< for the work files; empty: beside the output
  ingest::ResumeKey resume_key;  ///< what decides the output (the sources' checksums); a work directory left under the
                                 ///< same key is continued. None: every build starts afresh.
  double dice = kDice;  ///< of a mesh: an edge longer than so many times what is usual around it is cut; 0: none is
  bool coded = false;   ///< the file in the coded form
  std::function<void(const ingest::BuildPlan&)> on_plan;  ///< may be empty
  std::function<void()> on_written;  ///< may be empty; the output is in its place, and work files are still removed
};

struct BuildSummary : ingest::SourceSummary {
  std::uint64_t added_leaves = 0;  ///< by dicing large triangles
  lod::qsplat::Header header;
};

/// Mesh files, or point clouds without any face, to `output_path`, which appears whole or not at all. Errors: what is
/// wrong with a file (kInvalidInput, kUnsupported, kNotFound), kCancelled (progress said so), kNoSpace (disk; memory
/// too small), kBusy (another builder is at work there), kIo. After kCancelled, kNoSpace and kIo a rerun with the same
/// resume_key goes on.
base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress = nullptr);

}  // namespace lod::qsplat::builder
