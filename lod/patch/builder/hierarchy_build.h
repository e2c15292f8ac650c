#pragma once
// Builds patch.lgp from mesh files (Okamoto 2011, section 4.1): triangles are sorted to disk by voxels, METIS cuts them
// into leaf patches, and levels are regrouped and simplified. The build is out of core: data beyond the memory given
// lies in files of a work directory, and a build that was stopped or killed continues from there.
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "lod/ingest/staged_build.h"
#include "lod/patch/codec.h"
#include "lod/patch/hierarchy.h"
#include "lod/texture/format.h"

namespace lod::patch::builder {

struct HierarchyOptions : ingest::StagedBuildOptions {
  std::uint32_t voxel_triangles = 500;  ///< Nv: a voxel over this is subdivided
  std::uint32_t leaf_triangles = 4000;  ///< Nl: most triangles of a leaf patch
  std::uint32_t node_triangles = 2000;  ///< Nn: most triangles of any other patch
  std::uint32_t group_patches = 6;      ///< about how many patches make a group
  ingest::StitchOptions stitch;         ///< how the seams of the source are closed
  /// Levels above the leaves store these, with colours and without (docs/decisions/normals-of-facets.md).
  StoredNormals normals_beside_colors = StoredNormals::kOfVertices;
  StoredNormals normals_without_colors = StoredNormals::kOfVertices;
  /// Where the textures of the leaves go (docs/formats/texture.md), for a source that has some; empty: they only colour
  /// the vertices.
  std::string texture_path;
  std::function<void(base::Bytes)> on_texture_bytes;  ///< may be empty; gets all of that file's bytes in their order
  bool regroup = true;  ///< false: the paper's binary tree, whose locked borders pile up (for the chart)
};

struct LevelSummary {
  std::uint64_t triangles = 0;
  std::uint64_t patches = 0;
  float max_error = 0.0F;      ///< scene units
  double typical_error = 0.0;  ///< scene units: the root mean square over the triangles of what their groups state
};

struct HierarchySummary : ingest::SourceSummary {
  std::vector<LevelSummary> levels;                ///< 0 = leaves
  std::optional<texture::TextureSummary> texture;  ///< where textures were kept
};

/// Mesh files to `output_path`, which appears whole or not at all. Errors: what is wrong with a file (kInvalidInput,
/// kUnsupported, kNotFound), options out of range, kCancelled (progress said so), kNoSpace (disk; memory too small),
/// kBusy (another builder is at work there), kIo. After kCancelled, kNoSpace and kIo a rerun with the same resume_key
/// goes on.
base::Result<HierarchySummary> buildHierarchyFromFiles(const std::vector<std::string>& paths,
                                                       const HierarchyOptions& options, const std::string& output_path,
                                                       const ingest::Progress& progress = nullptr);

}  // namespace lod::patch::builder
