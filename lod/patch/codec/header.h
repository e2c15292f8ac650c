#pragma once
// The 32 bytes in front of an encoded patch (docs/formats/patch.md, "One patch as bytes").
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>

#include "base/bytes.h"
#include "base/error.h"

namespace lod::patch::codec {

/// Version 2 has low bits apart; a patch without them is written as version 1.
inline constexpr std::uint8_t kCodecVersion = 2;
inline constexpr std::size_t kHeaderBytes = 32;
inline constexpr std::size_t kCrcOffset = 28;

/// PatchHeader::flags.
inline constexpr std::uint8_t kHasColors = 1;
inline constexpr std::uint8_t kHasAlpha = 2;
inline constexpr std::uint8_t kIsRough = 4;
inline constexpr std::uint8_t kNormalsOfFacets = 8;
/// The flags from here up are a number: how many of the lowest bits of positions are stored apart.
inline constexpr int kLowBitsShift = 4;
inline constexpr int kMostLowBits = 15;

/// A front of 65 535 triangles has fewer than 2^17 edges.
inline constexpr std::uint8_t kMaxFrontBits = 17;
/// Differences of two lattice coordinates have 31 bits.
inline constexpr std::uint8_t kMaxFacetShift = 31;

struct PatchHeader {
  std::uint8_t flags = 0;
  std::uint32_t vertices = 0;
  std::uint32_t triangles = 0;
  std::uint8_t facet_shift = 0;    ///< bits dropped from coordinates before facet normals are summed
  std::uint8_t front_bits = 0;     ///< the front's ring has 2^front_bits places
  glm::ivec3 first_position{0};    ///< lattice point of vertex 0
  std::uint32_t steps = 0;         ///< steps of the cut-border machine
  std::uint32_t escape_bytes = 0;  ///< known vertices included
  std::uint32_t crc = 0;

  bool hasColors() const { return (flags & kHasColors) != 0; }
  bool hasAlpha() const { return (flags & kHasAlpha) != 0; }
  bool hasNormals() const { return (flags & kNormalsOfFacets) == 0; }
  /// Positions are predicted as a + ((b − opposite) >> shift): from whole parallelograms, or on noisy surfaces from
  /// half ones.
  int parallelogramShift() const { return (flags & kIsRough) != 0 ? 1 : 0; }
  /// Positions are stored in steps of 2^lowBits() of the lattice's, and what that leaves apart.
  int lowBits() const { return flags >> kLowBitsShift; }
  std::size_t stepBytes() const { return (std::size_t{steps} + 3) / 4; }
};

void writeHeader(base::ByteWriter& out, const PatchHeader& header);
/// Checks version, flags, ranges, and that the bytes hold the steps and escapes that the header states. The checksum is
/// not looked at.
base::Result<PatchHeader> readHeader(base::ByteView bytes);

/// CRC-32C of everything but the checksum's own four bytes.
std::uint32_t checksum(base::ByteView bytes);

base::Error brokenPatch(const std::string& problem);

}  // namespace lod::patch::codec
