#pragma once
// The lattice that a build lays over its source, so that positions become whole numbers.
#include <cstdint>
#include <glm/glm.hpp>

#include "lod/ingest/source_spool.h"
#include "lod/lattice.h"

namespace lod::ingest {

/// Maps a world position to q = round((world − corner) / step), 0 … 2^bits − 1 on each axis.
struct SourceLattice {
  glm::dvec3 corner{0.0};  ///< world position of lattice point 0
  Lattice lattice;         ///< the same lattice, relative to the scene's origin
  std::uint32_t bits = 10;

  glm::ivec3 point(const glm::dvec3& world) const;
};

constexpr std::uint32_t kMinLatticeBits = 10;

/// 0 to choose, or 10 … 21. Error: kInvalidInput for others.
base::Result<void> checkPositionBits(std::uint32_t bits);
/// `bits` 0 chooses 14 … 21 bits, so that a step is at most 1/16 of the mean edge, and half of the edge than which a
/// tenth are shorter, where 21 bits allow it; and more where a hundredth of the triangles would be lost and finer
/// positions keep most of these. `origin` is the scene's.
SourceLattice makeLattice(const SourceInfo& info, const glm::dvec3& origin, std::uint32_t bits);

/// Whether 21 bits would keep more than half of the triangles that are lost with so many.
bool finerKeepsMost(const SourceInfo& info, std::uint32_t bits);

/// Above this share of the triangles their loss is told, and bits are added to prevent it; a choice.
constexpr double kToldShare = 0.01;

}  // namespace lod::ingest
