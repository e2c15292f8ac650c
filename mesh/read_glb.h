#pragma once
// GLB: the binary form of glTF 2.0 (Khronos specification, section numbers below refer to it).
#include "mesh/mesh_stream.h"

namespace mesh {

/// Bytes of a whole file -> the stream, block by block. Errors name the place in the file, not the file.
base::Result<void> readGlb(base::ByteView bytes, MeshStream& out);

}  // namespace mesh
