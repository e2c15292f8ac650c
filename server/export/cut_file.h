#pragma once
// Writes one cut of a scene's hierarchy as a single mesh: PLY, or GLB.
#include <cstdint>
#include <functional>
#include <limits>
#include <string>

#include "base/error.h"
#include "lod/patch/traverse.h"
#include "server/export/surface.h"

namespace server::exports {

/// The most triangles that a cut may have unless one says otherwise: the leaves.
inline constexpr std::uint64_t kAllTriangles = std::numeric_limits<std::uint64_t>::max();

struct ExportCut {
  lod::patch::Cut cut;
  float error = 0.0F;  ///< the largest visible error in it, scene units; 0: the leaves
};
/// Refines where the visible error is largest, wherever that is, as long as there are at most `max_triangles`. Errors:
/// kInvalidInput where the coarsest cut has more.
base::Result<ExportCut> selectCutForExport(const lod::patch::Hierarchy& hierarchy, std::uint64_t max_triangles);

struct CutFileReport {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::uint64_t bytes = 0;
};

/// Called with the share that is written; false cancels.
using CutProgress = std::function<bool(double done)>;

/// Writes binary PLY with world coordinates as doubles; colours where there are some, normals where the scene is lit.
/// Vertices of different patches at one lattice point are one, so that the mesh is as closed as the source. The file
/// appears whole or not at all. Needs memory for the vertices along borders of patches. Errors: damaged files,
/// kUnsupported for more than 2^31 vertices, kCancelled, kNoSpace, kIo.
base::Result<CutFileReport> writeCutAsPly(const ExportScene& scene, const lod::patch::Cut& cut, const std::string& path,
                                          const CutProgress& progress);

/// Writes GLB: relative to the scene's origin, in metres, `up` of the scene as y; leaves have their textures. Needs
/// memory for the whole file. Errors: as above; kUnsupported for more than 4 GiB.
base::Result<CutFileReport> writeCutAsGlb(const ExportScene& scene, const lod::patch::Cut& cut, const std::string& path,
                                          const CutProgress& progress);

}  // namespace server::exports
