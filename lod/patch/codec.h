#pragma once
// One patch as bytes: triangles as steps of a cut-border machine (Gumhold and Strasser 1998, "Real Time Compression of
// Triangle Mesh Connectivity"), lattice positions predicted by parallelograms (Touma and Gotsman 1998, "Triangle Mesh
// Compression"), normals by the facets around them, colours by neighbours; differences in Rice codes whose width
// changes every 16 numbers. docs/formats/patch.md, "One patch as bytes", defines every bit.
//
// Octahedral normals: Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors",
// section 3.3, with 8 + 8 bits (at most 1 degree off).
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

/// Most vertices one patch may have (16-bit indices).
inline constexpr std::size_t kMaxPatchVertices = 65535;
inline constexpr std::size_t kMaxPatchTriangles = 65535;
/// Lattice coordinates stay within ±(2^30 − 1), so that differences of two fit 32 bits.
inline constexpr std::int32_t kMaxLattice = (1 << 30) - 1;

/// Bytes of a patch, checksum included. Triangles and vertices may be reordered, triangles rotated (a b c as b c a),
/// and vertices that no triangle uses are left out: the surface is the same. Alpha is stored as given. The same
/// geometry gives the same bytes. The caller sees to: 1 … kMaxPatchTriangles triangles, at most kMaxPatchVertices
/// vertices, indices in range, lattice points within ±kMaxLattice, normals (and colours, if any) as many as positions.
/// Safe to call from several threads.
base::Bytes encodePatch(const PatchGeometry& geometry);

/// The same bytes; `triangle_order`, unless null, is set to which input triangle became each decoded one: decoded
/// triangle i has the corners of input triangle (*triangle_order)[i].
base::Bytes encodePatch(const PatchGeometry& geometry, std::vector<std::uint32_t>* triangle_order);

/// Checks the checksum and every length and index; never reads past `bytes`, never allocates more than the limits above
/// need (12 MB, most of it kept by the thread for its next patch). Decoding gives back exactly what was encoded, but
/// for the order; normals are as quantizedNormal and colours as quantizedColor makes them.
base::Result<PatchGeometry> decodePatch(base::ByteView bytes);
/// The same without AVX2, as machines that lack it do: all that differs is speed.
base::Result<PatchGeometry> decodePatchPortably(base::ByteView bytes);
/// … or with AVX2 alone, as machines that lack AVX-512 do.
base::Result<PatchGeometry> decodePatchByAvx2(base::ByteView bytes);

/// What a patch's bytes say about its size, read from their header alone (the checksum is not looked at).
struct PatchCounts {
  std::uint32_t vertices = 0;
  std::uint32_t triangles = 0;
};
base::Result<PatchCounts> encodedCounts(base::ByteView bytes);

/// What the stored octahedral normal of n decodes to; the builder uses it so that shared vertices agree bit for bit.
/// Any length but zero; zero or NaN gives +z. quantizedNormal(quantizedNormal(n)) == quantizedNormal(n), bit for bit.
glm::vec3 quantizedNormal(const glm::vec3& n);
/// The same for many at once, which takes a fraction of the time for each.
void quantizeNormals(std::span<glm::vec3> normals);

/// What the stored colour of `color` decodes to: at most 3/255 off in a channel, alpha as it is. Applied twice it
/// changes nothing more.
glm::u8vec4 quantizedColor(const glm::u8vec4& color);

}  // namespace lod::patch
