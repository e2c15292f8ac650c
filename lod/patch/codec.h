#pragma once
// One patch as bytes: libmeshoptimizer's vertex and index codecs over lattice positions, octahedral normals and colours.
// docs/formats/patch.md
#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

/// Most vertices one patch may have (16-bit indices).
inline constexpr std::size_t kMaxPatchVertices = 65535;
inline constexpr std::size_t kMaxPatchTriangles = 65535;

/// Bytes of a patch, checksum included. Triangles and vertices may be reordered (the surface is the same).
base::Bytes encodePatch(const PatchGeometry& geometry);
/// Checks the checksum and every length and index; never reads past `bytes`.
base::Result<PatchGeometry> decodePatch(base::ByteView bytes);

/// What the stored octahedral normal of n decodes to; the builder uses it so that shared vertices agree bit for bit.
glm::vec3 quantizedNormal(const glm::vec3& n);

}  // namespace lod::patch
