#pragma once
// The low bits of positions in patches that are stored in coarser steps than the lattice's (docs/formats/patch.md, "Low
// bits").
#include <cstddef>
#include <span>

#include "base/bytes.h"
#include "lod/patch/codec/residuals.h"

namespace lod::patch::codec {

/// Appends the lowest `bits` (1 to 15) of the positions, for those vertices that have some; vertex 0 needs none.
void writeLowBits(base::ByteWriter& out, std::span<const Uint4> positions, int bits);

/// Reads what writeLowBits() wrote at `at`, moves `at` behind it, and sets low[v] for each vertex. False when it runs
/// past the end or holds bits that it may not. `in` must be readable 8 bytes past its end.
bool readLowBits(base::ByteView in, std::size_t& at, int bits, std::span<Uint4> low);

/// How many vertices but the first have bits among the lowest `bits`.
std::size_t countLowBits(std::span<const Uint4> positions, int bits);

}  // namespace lod::patch::codec
