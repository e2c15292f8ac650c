#pragma once
// The chunks of a leaf: entropy-coded points of a class, and triangles of a level (docs/formats/pmr.md, "Chunks"). Each
// ends with its checksum.
//
// A leaf's vertices at a level are numbered by falling class, from kCoarsest down to the level; in a class own points
// come first, then foreign ones. So the numbers of a coarse level's vertices stay valid at all finer ones.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/pmr/format.h"

namespace lod::pmr {

/// A point as the file has it.
struct CodedPoint {
  glm::ivec3 place{0};     ///< lattice point
  glm::u8vec2 normal{0};   ///< encodeNormal
  glm::u8vec3 color{255};  ///< sRGB; white where the file has no colours
  friend bool operator==(const CodedPoint&, const CodedPoint&) = default;
};
/// Octahedral code of a unit vector in 2 × 8 bits (Meyer et al. 2010, section 3.2), and its inverse, of length 1.
glm::u8vec2 encodeNormal(const glm::vec3& normal);
glm::vec3 decodeNormal(const glm::u8vec2& code);

/// Sorts points by the Morton codes of their places, equal ones by normal and colour: the order in which a chunk has
/// its own points, and the foreign ones behind them.
void sortForChunk(std::vector<CodedPoint>& points);
/// Both lists are in the order of sortForChunk().
base::Bytes encodePoints(std::span<const CodedPoint> own, std::span<const CodedPoint> foreign, bool colors);
/// Appends own and foreign points. Errors: kInvalidInput for a damaged chunk; `out` is then as before.
base::Result<void> decodePoints(base::ByteView chunk, std::uint32_t own, std::uint32_t foreign, bool colors,
                                std::vector<CodedPoint>& out);

/// `corners`: three different vertex numbers for each triangle, each triangle once; neither the order of triangles nor
/// that of corners is kept. `places`: of all vertices at the level.
base::Bytes encodeTriangles(std::span<const std::uint16_t> corners, std::span<const glm::ivec3> places);
/// Returns three corners for each of `triangles` triangles. Errors: kInvalidInput for a damaged chunk.
base::Result<std::vector<std::uint16_t>> decodeTriangles(base::ByteView chunk, std::uint32_t triangles,
                                                         std::span<const glm::ivec3> places);

}  // namespace lod::pmr
