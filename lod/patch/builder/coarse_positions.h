#pragma once
// Moves the vertices of a simplified group to a coarser lattice. A surface that is many steps off needs no vertices to
// the step, and the bits beyond take a tenth to two fifths of a coarse patch (docs/decisions/lattice-positions.md).
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "lod/patch/builder/simplify.h"

namespace lod::patch::builder {

/// How many of the lowest bits of its coordinates a group can do without, 0 to 15. `typical_error_below`: that of the
/// surfaces that it merges, in lattice steps, as a root mean square, 0 or more.
int spareBits(double typical_error_below);

/// Moves each surviving vertex that is not locked to the nearest lattice point whose coordinates are multiples of
/// 2^`bits`. `corner`: the lattice point that positions are relative to. A vertex stays where its move and those before
/// would turn a triangle over or take most of its area, where another vertex lies already, and where a coordinate would
/// be below 0.
void coarsenPositions(SimplifiedGroup& group, const std::vector<std::uint8_t>& locked, const glm::ivec3& corner,
                      int bits);

}  // namespace lod::patch::builder
