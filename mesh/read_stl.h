#pragma once
// Reads STL, ASCII and binary.
#include "mesh/mesh_stream.h"

namespace mesh {

/// Reads the bytes of a whole file into `out`, block by block. Errors name the place in the file, not the file.
base::Result<void> readStl(base::ByteView bytes, MeshStream& out);

/// Whether the file's length is that of a binary STL with as many triangles as it says, at least one.
bool isBinaryStlBySize(base::ByteView bytes);

}  // namespace mesh
