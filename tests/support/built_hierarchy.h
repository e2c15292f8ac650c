#pragma once
// Meshes of tests built by the patch builder, by way of a file, and what it wrote read back.
#include <string>
#include <utility>
#include <vector>

#include "lod/patch/builder/hierarchy_build.h"
#include "lod/patch/format.h"
#include "tests/support/ply_file.h"
#include "tests/support/scratch_directory.h"

namespace support {

/// A hierarchy file with everything read back: geometry[p] is patch p's.
struct BuiltHierarchy {
  lod::patch::Hierarchy hierarchy;
  std::vector<lod::patch::PatchGeometry> geometry;
  lod::patch::builder::HierarchySummary summary;
};

/// Opens and decodes a hierarchy file. Errors: those of reading it.
inline base::Result<BuiltHierarchy> readHierarchy(const std::string& path,
                                                  lod::patch::builder::HierarchySummary summary) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, lod::patch::PatchFile::open(path));
  BuiltHierarchy built;
  built.summary = std::move(summary);
  built.hierarchy = file.hierarchy();
  for (std::uint32_t p = 0; p < built.hierarchy.patches.size(); ++p) {
    LUMIGRID_ASSIGN_OR_RETURN(auto geometry, file.geometry(p));
    built.geometry.push_back(std::move(geometry));
  }
  return built;
}

/// Builds `output_path` from a mesh in memory.
inline base::Result<lod::patch::builder::HierarchySummary> buildHierarchy(
    const Mesh& mesh, const lod::patch::builder::HierarchyOptions& options, const std::string& output_path,
    const lod::ingest::Progress& progress = nullptr) {
  const ScratchDirectory scratch;
  writePly(scratch / "mesh.ply", mesh);
  return lod::patch::builder::buildHierarchyFromFiles({scratch / "mesh.ply"}, options, output_path, progress);
}

/// The same, read back.
inline base::Result<BuiltHierarchy> builtHierarchy(const Mesh& mesh,
                                                   const lod::patch::builder::HierarchyOptions& options = {}) {
  const ScratchDirectory scratch;
  LUMIGRID_ASSIGN_OR_RETURN(auto summary, buildHierarchy(mesh, options, scratch / "patch.lgp"));
  return readHierarchy(scratch / "patch.lgp", std::move(summary));
}

}  // namespace support
