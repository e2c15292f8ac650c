#pragma once
// Two-sided meshes, as CAD programs write them, have each triangle a second time, turned over. The normals of both
// cancel at vertices, and edges of four triangles do not collapse, so only one of the two is kept. A fold that the
// lattice has made flat looks alike, but its surface goes on from it on both sides, and would open without one.
#include <cstdint>
#include <span>
#include <vector>

#include "lod/ingest/border_vertices.h"

namespace lod::ingest {

/// The numbers, ascending, of triangles with the corners of an earlier one in the other order. `corners`: three for
/// each of less than 2^32 − 1 triangles. Triangles with the same corners in the same order are not among them, nor
/// sheets one of whose edges has two triangles more that are there once.
std::vector<std::uint32_t> turnedOver(std::span<const Corner> corners);

}  // namespace lod::ingest
