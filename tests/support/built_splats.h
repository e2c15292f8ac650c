#pragma once
// Meshes of tests built by the splat builder, by way of a file.
#include <string>

#include "lod/qsplat/builder/build.h"
#include "tests/support/ply_file.h"
#include "tests/support/scratch_directory.h"

namespace support {

/// Builds `output_path` from a mesh in memory.
inline base::Result<lod::qsplat::builder::BuildSummary> buildSplats(const Mesh& mesh,
                                                                    const lod::qsplat::builder::BuildOptions& options,
                                                                    const std::string& output_path,
                                                                    const lod::ingest::Progress& progress = nullptr) {
  const ScratchDirectory scratch;
  writePly(scratch / "mesh.ply", mesh);
  return lod::qsplat::builder::buildFromFiles({scratch / "mesh.ply"}, options, output_path, progress);
}

}  // namespace support
