#pragma once
// Builds a hlod.lgh from meshes (Guthe et al. 2004, section 3; docs/formats/hlod.md). The build is out of core: what
// does not fit the memory lies in a work directory, and a build that was stopped or killed goes on from there.
#include <cstdint>
#include <string>
#include <vector>

#include "lod/hlod/format.h"
#include "lod/ingest/staged_build.h"

namespace lod::hlod::builder {

/// The attributes that make the appearance of a surface.
enum class Appearance : std::uint8_t {
  kAuto,  ///< colours where the source has them, else normals
  kNormals,
  kColors,  ///< nothing where the source has none
  kColorsAndNormals,
  kShape,  ///< nothing: the error is that of the shape alone
};

struct BuildOptions : ingest::StagedBuildOptions {
  ingest::StitchOptions stitch;
  std::uint32_t leaf_triangles = 8000;  ///< Tmax: the most triangles of a leaf; 1 or more
  float resolution = 128.0F;            ///< res: a node's error is at most its cell's edge divided by this; above 2
  Appearance appearance = Appearance::kAuto;
  bool points = true;  ///< small triangles become points (section 3.2)
};

/// The nodes of one depth of the octree.
struct LevelSummary {
  std::uint64_t nodes = 0;
  std::uint64_t triangles = 0, points = 0;  ///< of the pictures
  std::uint64_t caster_triangles = 0;
  std::uint64_t picture_bytes = 0, caster_bytes = 0;
  float largest_error = 0.0F;  ///< scene units
};

struct BuildSummary : ingest::SourceSummary {
  Header header;
  std::vector<LevelSummary> levels;  ///< by depth, the root first
};

/// Builds `output_path` from mesh files. It appears whole or not at all. Errors: those of the files (kInvalidInput,
/// kUnsupported, kNotFound), kCancelled (by progress), kNoSpace (on the disk, or too little memory), kBusy (another
/// builder uses the work directory), kIo. After kCancelled, kNoSpace and kIo a rerun with the same resume_key goes on.
base::Result<BuildSummary> buildFromFiles(const std::vector<std::string>& paths, const BuildOptions& options,
                                          const std::string& output_path, const ingest::Progress& progress = nullptr);

}  // namespace lod::hlod::builder
