#pragma once
// PLY: ASCII and both binary orders (Turk 1994, "The PLY Polygon File Format")
#include "mesh/mesh_stream.h"

namespace mesh {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readPly(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
