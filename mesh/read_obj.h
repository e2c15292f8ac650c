#pragma once
// Wavefront OBJ: v (with optional colour), vn, f.
#include "mesh/mesh_stream.h"

namespace mesh {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readObj(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
