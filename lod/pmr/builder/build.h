#pragma once
// Builds a pmr.lgm from points (Dey and Hudson 2002, section 2; docs/formats/pmr.md): meshes are taken as their
// vertices. The build is out of core: what does not fit the memory lies in a work directory, and a build that was
// stopped or killed goes on from there.
#include <cstdint>
#include <string>
#include <vector>

#include "lod/ingest/staged_build.h"
#include "lod/pmr/format.h"

namespace lod::pmr::builder {

struct BuildOptions : ingest::StagedBuildOptions {};

struct BuildSummary : ingest::SourceSummary {
  Header header;
  std::uint64_t duplicates = 0;                 ///< points at the place of another, which were left out
  std::uint64_t outliers = 0;                   ///< points that no umbrella uses at level 0
  std::array<std::uint64_t, kLevels> points{};  ///< at each level
  std::array<std::uint64_t, kLevels> triangles{};
};

/// Builds `output_path` from mesh files or point clouds. It appears whole or not at all. Errors: those of the files
/// (kInvalidInput, kUnsupported, kNotFound), kCancelled (by progress), kNoSpace (on the disk, or too little memory),
/// kBusy (another builder uses the work directory), kIo. After kCancelled, kNoSpace and kIo a rerun with the same
/// resume_key goes on.
base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress = nullptr);

}  // namespace lod::pmr::builder
