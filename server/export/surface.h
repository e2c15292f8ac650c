#pragma once
// Turns patches of a scene, and the pages of its leaves, into the triangles of a GLB.
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "lod/texture/format.h"
#include "server/export/glb.h"

namespace server::exports {

/// A built scene as exports need it.
struct ExportScene {
  base::Scene scene;
  lod::patch::PatchFile patches;
  std::optional<lod::texture::TextureFile> textures;
  int jpeg_quality = 90;  ///< of pages, 1 … 100

  bool unlit() const { return scene.light.mode == base::LightMode::kUnlit; }
  const lod::patch::Hierarchy& hierarchy() const { return patches.hierarchy(); }
};

/// Opens the patches of a scene and, where it has them, its textures. Errors name the file; kNotFound where there is no
/// patch hierarchy.
base::Result<ExportScene> openForExport(const std::string& directory);

/// Metres in a unit of the scene; 1 where its units are not known.
double metresPerUnit(const base::Scene& scene);

/// A lattice point that float positions count from: the nearest of those that lie 2^22 steps apart from the middle of
/// the scene. Within such a cell a float is less than half a step off, and all tiles of a cell have the same origin, so
/// that equal lattice points have equal floats and no crack opens between tiles.
glm::ivec3 floatOriginNear(const lod::patch::Hierarchy& hierarchy, const glm::vec3& place);

/// The matrix from positions relative to the lattice point `origin` to glTF's axes: those of the scene after 3D Tiles
/// have turned y up to z up. Its translation is relative to the scene's origin.
glm::dmat4 tileFromMesh(const lod::Lattice& lattice, const glm::ivec3& origin);

using AddPrimitive = std::function<base::Result<void>(GlbPrimitive&&)>;
/// Makes primitives of patches, with positions relative to the lattice point `origin`: one for each page, and such of
/// at most kMaxShortVertices vertices for triangles that are on no page. `go_on` may be null; it is called for each
/// patch, and false cancels. Errors: damaged files, kCancelled, those of `add`.
base::Result<void> addSurface(const ExportScene& scene, std::span<const std::uint32_t> patches,
                              const glm::ivec3& origin, const AddPrimitive& add,
                              const std::function<bool(std::size_t done)>& go_on);

}  // namespace server::exports
