#pragma once
// Encodes one patch as bytes, and decodes it. Triangles are steps of a cut-border machine (Gumhold and Strasser 1998,
// "Real Time Compression of Triangle Mesh Connectivity"). Lattice positions are predicted by parallelograms (Touma and
// Gotsman 1998, "Triangle Mesh Compression"), octahedral normals of 8 + 8 bits by the facets around them, colours by
// neighbours. Residuals are Rice codes whose width changes every 16 numbers. docs/formats/patch.md, "One patch as
// bytes", defines every bit; the folder codec/ has a file for each of these subjects.
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

/// The most vertices of one patch: 16-bit indices.
inline constexpr std::size_t kMaxPatchVertices = 65535;
/// The most triangles: the header stores their count in 16 bits.
inline constexpr std::size_t kMaxPatchTriangles = 65535;
/// Lattice coordinates stay within ±(2^30 − 1), so that differences of two fit 32 bits.
inline constexpr std::int32_t kMaxLattice = (1 << 30) - 1;

enum class StoredNormals : std::uint8_t { kOfVertices, kOfFacets };

/// The bytes of a patch, checksum included. Triangles and vertices may be reordered, triangles rotated (a b c as b c
/// a), and vertices that no triangle uses are left out: the surface is the same. Alpha is stored as given. The same
/// geometry gives the same bytes. The caller sees to: 1 … kMaxPatchTriangles triangles, at most kMaxPatchVertices
/// vertices, indices in range, lattice points within ±kMaxLattice, normals (and colours, if any) as many as positions.
/// Safe to call from several threads.
///
/// `triangle_order`, unless null, is set to which input triangle became each decoded one: decoded triangle i has the
/// corners of input triangle (*triangle_order)[i].
///
/// `normals`: with kOfFacets those of vertices are replaced by those of the facets around them in this patch, and take
/// no bytes.
base::Bytes encodePatch(const PatchGeometry& geometry, std::vector<std::uint32_t>* triangle_order = nullptr,
                        StoredNormals normals = StoredNormals::kOfVertices);

/// Checks the checksum and every length and index, never reads past `bytes`, and never allocates more than the limits
/// above need (12 MB, most of which the thread keeps for its next patch). Decoding gives back exactly what was encoded,
/// but for the order; normals are as quantizeNormals() and colours as quantizedColor() makes them.
base::Result<PatchGeometry> decodePatch(base::ByteView bytes);
/// The same without AVX2, as on machines that lack it; only the speed differs.
base::Result<PatchGeometry> decodePatchPortably(base::ByteView bytes);
/// The same with AVX2 alone, as on machines that lack AVX-512.
base::Result<PatchGeometry> decodePatchByAvx2(base::ByteView bytes);

/// Counts that the header of a patch's bytes states; the checksum is not looked at.
struct PatchCounts {
  std::uint32_t vertices = 0;
  std::uint32_t triangles = 0;
};
base::Result<PatchCounts> encodedCounts(base::ByteView bytes);
/// The same, and checks the checksum of all the bytes.
base::Result<PatchCounts> checkedCounts(base::ByteView bytes);

/// Replaces normals by those that their stored octahedral codes decode to; the builder uses it so that shared vertices
/// agree bit for bit. They have any length but zero; zero or NaN gives +z. Applied twice it changes nothing more.
void quantizeNormals(std::span<glm::vec3> normals);

/// The colour that the stored code of `color` decodes to: at most 3/255 off in a channel, alpha as it is. Applied twice
/// it changes nothing more.
glm::u8vec4 quantizedColor(const glm::u8vec4& color);

}  // namespace lod::patch
