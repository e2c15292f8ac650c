#pragma once
// OFF, COFF, NOFF, CNOFF, with or without ST (Geomview's format, ASCII).
#include "mesh/mesh_stream.h"

namespace mesh {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readOff(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
