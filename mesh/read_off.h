#pragma once
// Reads Geomview's ASCII formats OFF, COFF, NOFF and CNOFF, with or without the prefix ST.
#include "mesh/mesh_stream.h"

namespace mesh {

/// Reads the bytes of a whole file into `out`, block by block. Errors name the place in the file, not the file.
base::Result<void> readOff(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
