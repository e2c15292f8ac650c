#pragma once
// Reads GLB, the binary form of glTF 2.0. Section numbers refer to the Khronos specification.
#include "mesh/mesh_stream.h"

namespace mesh {

/// Reads the bytes of a whole file into `out`, block by block. Errors name the place in the file, not the file.
base::Result<void> readGlb(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
