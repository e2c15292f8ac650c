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

/// 0 to choose, or 10 … 21. Error: kInvalidInput for others.
base::Result<void> checkPositionBits(std::uint32_t bits);
/// `bits` 0 chooses 14 … 21 bits, so that a step is at most 1/16 of the mean edge, and half of the edge than which a
/// tenth are shorter, where 21 bits allow it. `origin` is the scene's.
SourceLattice makeLattice(const SourceInfo& info, const glm::dvec3& origin, std::uint32_t bits);

}  // namespace lod::ingest
