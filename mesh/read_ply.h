#pragma once
// Reads PLY, ASCII and in both binary orders (Turk 1994, "The PLY Polygon File Format").
#include "mesh/mesh_stream.h"

namespace mesh {

/// Reads the bytes of a whole file into `out`, block by block. Errors name the place in the file, not the file.
base::Result<void> readPly(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
