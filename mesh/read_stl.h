#pragma once
// STL, ASCII and binary.
#include "mesh/mesh_stream.h"

namespace mesh {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readStl(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
