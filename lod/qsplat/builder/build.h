#pragma once
// Builds a qsplat.lgq from a mesh or points (Rusinkiewicz and Levoy 2000, sections 2.2 and 3; docs/formats/qsplat.md).
// Leaves are sorted on disk into tiles; each tile gets a tree, and a top tree joins them. The build is out of core:
// what does not fit the memory lies in a work directory, and a build that was stopped or killed goes on from there.
#include <cstdint>
#include <string>
#include <vector>

#include "lod/ingest/staged_build.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

/// The default of BuildOptions::dice, found by trying (docs/results/qsplat.md).
inline constexpr double kDefaultDice = 2.0;

struct BuildOptions : ingest::StagedBuildOptions {
  double dice = kDefaultDice;  ///< edges of a mesh longer than this many times the mean around them are cut; 0: none is
  bool coded = false;          ///< write the coded form
};

struct BuildSummary : ingest::SourceSummary {
  std::uint64_t added_leaves = 0;  ///< by dicing large triangles, and repeating leaves far from all others
  Header header;
};

/// Builds `output_path` from mesh files, or from point clouds without any face. It appears whole or not at all. Errors:
/// those of the files (kInvalidInput, kUnsupported, kNotFound), kCancelled (by progress), kNoSpace (on the disk, or too
/// little memory), kBusy (another builder uses the work directory), kIo. After kCancelled, kNoSpace and kIo a rerun
/// with the same resume_key goes on.
base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress = nullptr);

}  // namespace lod::qsplat::builder
